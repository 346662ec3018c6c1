/** A notice that the server has gone, with what to do. */

import type { App } from './app';

const PATIENCE = 2500; // ms without a connection before the notice

export class Toast {
  private readonly box = document.createElement('div');
  private readonly text = document.createElement('p');
  private since = NaN;

  constructor(
    parent: HTMLElement,
    private readonly app: App,
  ) {
    this.box.className = 'toast';
    this.box.setAttribute('role', 'alert');
    this.box.hidden = true;
    const again = document.createElement('button');
    again.className = 'push';
    again.textContent = 'Reload the page';
    again.onclick = () => location.reload();
    this.box.append(this.text, again);
    parent.append(this.box);
    setInterval(() => this.look(), 500);
  }

  private look(): void {
    const gone = this.app.model.line === 'reconnecting' && !this.app.model.leaving;
    if (!gone) this.since = NaN;
    else if (Number.isNaN(this.since)) this.since = performance.now();
    const shown = gone && performance.now() - this.since > PATIENCE;
    if (shown === !this.box.hidden) return;
    const name = this.app.model.scene?.name ?? '';
    this.text.textContent = `The server does not answer. If it has ended, run "twin serve ${name}" again: this page then reconnects by itself.`;
    this.box.hidden = !shown;
  }
}
