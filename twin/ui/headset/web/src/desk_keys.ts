/** Keys for a robot without a console: play, undo; and the list of the keys, also of a console. */

import type { App } from './app';
import { consoleHelp } from './help_console';
import { HelpDialog, type HelpPart } from './help_dialog';

const HELP: readonly (readonly [what: string, how: string])[] = [
  ['Move the tool', 'drag the blue ring; with Shift, the tool rotates'],
  ['Move any link', 'drag it: the mechanism follows'],
  ['Rotate the view', 'drag the background; one finger on a touch screen'],
  ['Zoom', 'wheel, or two fingers'],
  ['Play or pause', 'Space'],
  ['Undo the last drag', 'Ctrl-Z'],
  ['Show these keys', '?'],
  ['Hide them', 'Escape'],
];

export class DeskKeys {
  private readonly list: HelpDialog;

  constructor(
    parent: HTMLElement,
    private readonly app: App,
  ) {
    const robot: HelpPart[] = [{ head: '', rows: () => HELP }];
    this.list = new HelpDialog(parent, () => (app.console ? consoleHelp(app.console, () => app.model.console) : robot));
    window.addEventListener('keydown', (e) => this.press(e));
  }

  /** Show or hide the list. */
  toggle(): void {
    this.list.toggle();
  }

  private press(e: KeyboardEvent): void {
    if (e.target instanceof HTMLSelectElement) return;
    if (this.app.console) {
      // the other keys of a console move its hands, see keys.ts
      const asks = e.key === '?' && !e.repeat && !e.ctrlKey && !e.metaKey && !e.altKey;
      if (asks) this.toggle();
      return;
    }
    const command = e.ctrlKey || e.metaKey;
    const undo = command && !e.shiftKey && !e.altKey && e.key.toLowerCase() === 'z';
    if ((command || e.altKey) && !undo) return;
    // the list of the keys covers the robot: only its own key acts then
    if (this.list.open && e.key !== '?') return;
    // on a button, Space presses the button
    const play = e.code === 'Space' && !(e.target instanceof HTMLButtonElement);
    if (!undo && !play && e.key !== '?') return;
    e.preventDefault();
    if (undo) this.app.ask('undo', {});
    // a key that is held down repeats, which would switch there and back
    else if (e.repeat) return;
    else if (play) this.play();
    else this.toggle();
  }

  private play(): void {
    const { state } = this.app.model;
    if (state.duration > 0) this.app.ask('play', { on: !state.playing });
  }
}
