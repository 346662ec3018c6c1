/** Keys for a robot without a console: play, undo, and a list of the keys. */

import type { App } from './app';

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
  private readonly list = document.createElement('dialog');

  constructor(
    parent: HTMLElement,
    private readonly app: App,
  ) {
    this.list.className = 'keys';
    this.list.setAttribute('aria-label', 'Mouse and keys');
    const table = document.createElement('table');
    for (const [what, how] of HELP) {
      const row = table.insertRow();
      const name = document.createElement('th');
      name.scope = 'row';
      name.textContent = what;
      row.append(name);
      row.insertCell().textContent = how;
    }
    const close = document.createElement('button');
    close.className = 'push';
    close.textContent = 'Close';
    close.onclick = () => this.list.close();
    this.list.append(table, close);
    parent.append(this.list);
    window.addEventListener('keydown', (e) => this.press(e));
  }

  /** Show or hide the list. */
  toggle(): void {
    if (this.list.open) this.list.close();
    else this.list.showModal();
  }

  private press(e: KeyboardEvent): void {
    if (this.app.console || e.target instanceof HTMLSelectElement) return;
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
