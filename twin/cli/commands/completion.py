"""`twin completion`: print a script with which a shell completes commands, robots and options."""

from __future__ import annotations

import argparse
import contextlib
import io
from typing import Any

from twin.cli.parser import Command

EXAMPLES = """\
  twin completion bash    into ~/.local/share/bash-completion/completions/twin, by > FILE
  twin completion zsh     into ~/.zfunc/_twin, with fpath+=~/.zfunc before compinit in ~/.zshrc
  twin completion fish    into ~/.config/fish/completions/twin.fish"""

SHELLS = ("bash", "zsh", "fish")

_BASH = """\
_twin() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} words
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{commands}"
    else
        case "${{COMP_WORDS[1]}}" in
{options}
        esac
        case "$word" in
            -*) ;;
            *) words="{robots}" ;;
        esac
    fi
    COMPREPLY=( $(compgen -W "$words" -- "$word") )
    [ "$COMP_CWORD" -gt 1 ] && case "$word" in -*) ;; *) COMPREPLY+=( $(compgen -f -- "$word") ) ;; esac
}}
complete -o filenames -F _twin twin
"""


_ZSH_END = """\
# Autoloaded at the first TAB, this file is the body of _twin, which has only defined functions until here.
if [[ ${funcstack[1]} == _twin ]]; then
    _bash_complete -o filenames -F _twin
fi
"""


def arguments(command: Command) -> None:
    """Add the arguments of `twin completion`."""
    command.add_argument("shell", choices=SHELLS, help="the shell")


def run(args: argparse.Namespace) -> int:
    """Print the script of a shell."""
    from twin.cli import show
    from twin.cli.commands import HELP
    from twin.core import assets

    robot_names = [*assets.names(), *assets.scenes()]
    options = {name: _options(name) for name in HELP}
    if args.shell == "fish":
        script = _fish(HELP, options, robot_names)
    else:
        script = _bash(list(HELP), options, robot_names)
        if args.shell == "zsh":
            script = f"#compdef twin\nautoload -U +X bashcompinit && bashcompinit\n{script}{_ZSH_END}"
    if args.json:
        print(show.as_json(show.record("completion", {"shell": args.shell, "script": script})))
    else:
        print(script, end="")
    return 0


def _options(name: str) -> list[str]:
    """Return the options of a command, without their short forms."""
    from twin.cli.parser import parser

    command: Any = None
    for action in parser()._actions:
        if isinstance(action.choices, dict):  # the subparsers
            command = action.choices[name]
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
        command.parse_known_args(["--help"])  # adds the arguments of the command
    options: list[str] = []
    for action in command._actions:
        for option in action.option_strings:
            if option.startswith("--"):
                options.append(option)
    return options


def _bash(commands: list[str], options: dict[str, list[str]], robots: list[str]) -> str:
    cases = []
    for name, names in options.items():
        cases.append(f'            {name}) words="{" ".join(names)}" ;;')
    lines = "\n".join(cases)
    return _BASH.format(commands=" ".join(commands), options=lines, robots=" ".join(robots))


def _fish(texts: dict[str, str], options: dict[str, list[str]], robots: list[str]) -> str:
    lines = []
    for name, text in texts.items():
        quoted = text.replace("'", "\\'")  # the only character that ends a text in single quotes
        lines.append(f"complete -c twin -n __fish_use_subcommand -a {name} -d '{quoted}'")
        condition = f"'__fish_seen_subcommand_from {name}'"
        lines.append(f"complete -c twin -n {condition} -a '{' '.join(robots)}'")
        for option in options[name]:
            lines.append(f"complete -c twin -n {condition} -l {option.removeprefix('--')}")
    return "\n".join(lines) + "\n"
