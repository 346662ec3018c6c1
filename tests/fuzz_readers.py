"""Throw damaged text at every text reader: nothing but a TwinError may come out, in time.

    python tests/fuzz_readers.py 100000                 each reader, that many inputs
    python tests/fuzz_readers.py 100000 mjcf usda       some of them
    python tests/fuzz_readers.py 2000 --seed 7 --out crashes/

Good files are damaged in one to six places: bytes, tokens, numbers, lines, pieces of other files. Each reader runs in
a process of its own, which names the input it is at; one that dies or hangs is started again behind it. What went
wrong is kept as a file. Of the descriptions that are read, one in fifty goes on: its loops are closed.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import multiprocessing
import random
import re
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).parent
DATA = HERE / "data/importing"

HANG = 20.0
"""Seconds of processor time that one input may take; 30 times as long by the clock, for native code hears no alarm."""

ODD = (
    *(b"nan", b"inf", b"-1", b"0", b"1e999", b"1e-320", b"-0.0", b"99999999999999999999", b"1e300", b"", b" ", b"true"),
    *(b"\x00", b"\xff\xfe", b"\xc3\xa9", b'"', b"'", b"<", b">", b"&", b"&lt;", b"{", b"}", b"[", b"]", b"#", b"="),
    *(b":", b"\n", b"\r\n", b"\t", b"..", b"/", b"//", b"../../", b"~", b"%s", b"*", b"&a", b"\\"),
    b"!!python/object:os.system",
)


@dataclass(frozen=True)
class Reader:
    """One reader: the files it is fed with, the name an input gets, and the call."""

    seeds: tuple[Path, ...]
    name: str
    call: Callable[[Path, bool], None]


def _description(path: Path, on: bool) -> None:
    from twin.exchange.read import read
    from twin.exchange.read.loop_closing import close

    found = read(path, guarded=False)
    if on and len(found.mechanism.joints) < 40:
        close(found)


def _closures(path: Path, on: bool) -> None:
    from twin.exchange.formats.urdf.read import read_urdf
    from twin.exchange.formats.urdf.read.closures import read_closures

    read_urdf(DATA / "models/fourbar.urdf", path) if on else read_closures(path)


def _robot(path: Path, on: bool) -> None:
    from twin.cad import references
    from twin.cad.build import read_mechanism
    from twin.cad.description import load

    description = load(path)
    references.check(path, description)
    if on and description.step is None and not any(b.meshes for b in description.body.values()):
        read_mechanism(path, with_mass=False)


def _protocol(path: Path, on: bool) -> None:
    from twin.planning.protocol import load_protocol

    load_protocol(path)


def readers() -> dict[str, Reader]:
    """Return the readers by name."""
    root = HERE.parent
    models = DATA / "models"
    return {
        "urdf": Reader((models / "fourbar.urdf", models / "slider.urdf", DATA / "good.urdf"), "x.urdf", _description),
        "closures": Reader((models / "fourbar.yaml", models / "slider.yaml"), "x.yaml", _closures),
        "mjcf": Reader((models / "fourbar.xml", models / "slider.xml", DATA / "good.xml"), "x.xml", _description),
        "sdf": Reader((models / "fourbar.sdf", models / "slider.sdf", DATA / "good.sdf"), "x.sdf", _description),
        "usda": Reader((models / "fourbar.usda", models / "slider.usda"), "x.usda", _description),
        "robot": Reader((DATA / "given.toml", HERE / "data/cad/crank.toml"), "given.toml", _robot),
        "protocol": Reader(tuple(sorted((root / "trajectories/sils").glob("*.toml"))), "x.toml", _protocol),
    }


TOKEN = re.compile(rb"[A-Za-z_][A-Za-z_0-9:.]*|-?[0-9.]+(?:[eE][-+]?[0-9]+)?|\s+|.", re.DOTALL)


def damaged(rng: random.Random, seeds: list[bytes], tokens: list[list[bytes]]) -> bytes:
    """Return one of the seeds with one to six things wrong."""
    text = rng.choice(seeds)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        if not text:
            return text
        kind = rng.randrange(9)
        at = rng.randrange(len(text))
        if kind == 0:  # a byte
            text = text[:at] + bytes([rng.randrange(256)]) + text[at + 1 :]
        elif kind == 1:  # a piece is gone
            text = text[:at] + text[at + rng.choice((1, 2, 5, 20, 100)) :]
        elif kind == 2:  # something odd comes in
            text = text[:at] + rng.choice(ODD) + text[at:]
        elif kind == 3:  # a piece of another file
            other = rng.choice(seeds)
            start = rng.randrange(len(other))
            text = text[:at] + other[start : start + rng.choice((3, 10, 60, 300))] + text[at:]
        elif kind == 4:  # cut off
            text = text[:at]
        elif kind == 5:  # a line twice, or elsewhere
            lines = text.split(b"\n")
            lines.insert(rng.randrange(len(lines)), rng.choice(lines))
            text = b"\n".join(lines)
        elif kind == 6:  # a line is gone
            lines = text.split(b"\n")
            del lines[rng.randrange(len(lines))]
            text = b"\n".join(lines)
        else:  # a word or number becomes another one
            word = TOKEN.search(text, at) or TOKEN.match(text)
            assert word
            new = rng.choice(ODD) if rng.random() < 0.3 else rng.choice(rng.choice(tokens))
            text = text[: word.start()] + new + text[word.end() :]
    return text


@dataclass
class Result:
    """What a run found: how many inputs, how they ended, and what must not have happened."""

    count: int = 0
    seconds: float = 0.0
    ends: collections.Counter = field(default_factory=collections.Counter)
    crashes: list[tuple[int, str, bytes]] = field(default_factory=list)


def inputs(name: str, seed: int):
    """Yield input after input of a reader; the same for the same seed."""
    reader = readers()[name]
    rng = random.Random(f"{name} {seed}")
    seeds = [p.read_bytes() for p in reader.seeds]
    tokens = [[m.group() for m in TOKEN.finditer(s) if m.group().strip()] for s in seeds]
    while True:
        yield damaged(rng, seeds, tokens)


def _work(name: str, seed: int, first: int, last: int, place: str, pipe) -> None:
    """Run inputs first..last; say which one is next, and how each ended."""
    from twin.core.errors import TwinError

    warnings.simplefilter("ignore")
    reader, folder = readers()[name], Path(place)

    def late(*_) -> None:
        raise TimeoutError(f"not done after {HANG:g} s")

    # A native module that an alarm interrupts while it is imported may crash: all are imported before the first.
    with contextlib.suppress(TwinError):
        (folder / reader.name).write_bytes(reader.seeds[0].read_bytes())
        reader.call(folder / reader.name, True)
    signal.signal(signal.SIGVTALRM, late)
    ends: collections.Counter = collections.Counter()
    for i, data in enumerate(inputs(name, seed)):
        if i < first:
            continue
        if i >= last:
            break
        path = folder / reader.name
        path.write_bytes(data)
        if i % 50 == 0:
            pipe.send(("at", i, dict(ends)))
            ends.clear()
        pipe_at.value = i
        signal.setitimer(signal.ITIMER_VIRTUAL, HANG)
        try:
            reader.call(path, i % 50 == 0)
            ends["read"] += 1
        except TwinError:
            ends["refused"] += 1
        except BaseException as error:
            kind = "hang" if isinstance(error, TimeoutError) else "crash"
            pipe.send((kind, i, "".join(traceback.format_exception(error))[-1500:]))
            ends[kind] += 1
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    pipe.send(("end", last, dict(ends)))


pipe_at = multiprocessing.Value("q", 0, lock=False)


def run(name: str, count: int, seed: int = 0) -> Result:
    """Feed a reader with `count` inputs; a process that dies is started again behind the input that killed it."""
    context, result, first = multiprocessing.get_context("fork"), Result(), 0
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="twin-fuzz-", dir=_memory()) as place:
        while first < count:
            here, there = context.Pipe(duplex=False)
            process = context.Process(target=_work, args=(name, seed, first, count, place, there), daemon=True)
            process.start()
            there.close()
            first = _listen(here, process, name, seed, count, result)
            process.join()
    result.count, result.seconds = count, time.monotonic() - begun
    return result


def _listen(here, process, name: str, seed: int, count: int, result: Result) -> int:
    """Collect what a process says until it is done or gone; return where to go on."""
    while True:
        try:
            if not here.poll(30 * HANG):
                process.kill()
                raise EOFError
            kind, i, what = here.recv()
        except (EOFError, OSError):
            process.join()
            i = int(pipe_at.value)
            text = f"the process ended with {process.exitcode} (a signal if negative)"
            result.crashes.append((i, text, _input(name, seed, i)))
            result.ends["died"] += 1
            return i + 1
        if kind in ("at", "end"):
            result.ends.update(what)
            if kind == "end":
                return count
        else:
            result.crashes.append((i, what, _input(name, seed, i)))


def _input(name: str, seed: int, index: int) -> bytes:
    for i, data in enumerate(inputs(name, seed)):
        if i == index:
            return data
    raise AssertionError


def _memory() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def main(argv: list[str] | None = None) -> int:
    """Run; 1 if anything but a TwinError came out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, help="inputs for each reader")
    parser.add_argument("readers", nargs="*", metavar="READER", help=f"of {', '.join(readers())}; default all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("twin-out/fuzz"), help="where what went wrong is kept")
    options = parser.parse_args(argv)
    bad = 0
    for name in options.readers or readers():
        result = run(name, options.count, options.seed)
        ends = ", ".join(f"{n} {end}" for end, n in result.ends.most_common())
        print(f"{name:<9} {result.count} inputs, {result.seconds:.0f} s: {ends}", flush=True)
        for i, what, data in result.crashes:
            options.out.mkdir(parents=True, exist_ok=True)
            (options.out / f"{name}-{options.seed}-{i}").write_bytes(data)
            print(f"  input {i}: {what.strip().splitlines()[-1][:200]}", flush=True)
            (options.out / f"{name}-{options.seed}-{i}.txt").write_text(what)
        bad += len(result.crashes)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
