/** Header of the page: name, buttons to enter AR or VR, and help for the mouse. */

import type { App } from './app';
import type { Line } from './connection';
import { Coach } from './coach';
import { DeskKeys } from './desk_keys';
import { Headline } from './headline';
import { TaskList } from './task_list';
import { Toast } from './toast';

/** What the dot beside the name says. */
const LINES: Readonly<Record<Line, string>> = {
  connecting: 'Connecting to the server',
  open: 'Connected to the server',
  reconnecting: 'The server does not answer',
  refused: 'The server refuses this page',
};

const BESIDE = 0.3; // maximum fraction of the width that the header covers if the robot is drawn beside it

export class Header {
  private readonly bar = document.createElement('header');
  private readonly name = document.createElement('h1');
  private readonly dot = document.createElement('span');
  private readonly enter = document.createElement('button');
  private readonly other = document.createElement('button');
  private readonly about = document.createElement('p');
  private readonly help = document.createElement('p');
  private readonly more = document.createElement('button');
  private readonly headline: Headline;
  private readonly keys: DeskKeys;
  private readonly coach: Coach;
  private readonly tasks: TaskList;

  constructor(
    parent: HTMLElement,
    private readonly app: App,
  ) {
    this.dot.className = 'dot';
    this.enter.className = 'enter';
    this.enter.dataset['id'] = 'enter';
    this.other.className = 'push';
    this.other.dataset['id'] = 'enter-vr';
    this.about.dataset['id'] = 'xr';
    this.about.className = 'about';
    this.help.className = 'help';
    this.help.textContent = 'Drag the blue ring: the tool follows.';
    this.more.className = 'push more';
    this.more.dataset['id'] = 'keys';
    this.more.textContent = '?';
    this.more.title = 'What mouse, fingers and keys do';
    this.more.setAttribute('aria-label', 'Mouse and keys');
    this.headline = new Headline(app);
    this.keys = new DeskKeys(parent, app);
    this.more.onclick = () => this.keys.toggle();
    this.coach = new Coach(parent, app);
    this.tasks = new TaskList(app);
    new Toast(parent, app);
    const title = document.createElement('div');
    title.className = 'title';
    title.append(this.dot, this.name, this.more);
    const ways = document.createElement('div');
    ways.className = 'ways';
    ways.append(this.enter, this.other);
    this.bar.append(title, this.headline.box, this.tasks.box, ways, this.about);
    parent.append(this.bar, this.help);
    // On a small page, a form lies below the header, whose height depends on its text.
    const follow = () =>
      document.documentElement.style.setProperty('--head', `${this.bar.offsetTop + this.bar.offsetHeight}px`);
    new ResizeObserver(follow).observe(this.bar);
    this.enter.title = 'Show the robot in the headset of this device';
    this.other.title = 'Show the robot in a virtual room instead of yours';
    this.enter.onclick = () => void app.xr.enter();
    this.other.onclick = () => void app.xr.enter('immersive-vr');
  }

  /** Height in pixels that the header covers of an area of this width; 0 if there is space for the robot beside it. */
  covers(width: number): number {
    const { right, bottom } = this.bar.getBoundingClientRect();
    return right > BESIDE * width ? Math.round(bottom) : 0;
  }

  refresh(): void {
    const { xr, model } = this.app;
    this.name.textContent = model.scene?.title || model.scene?.name || 'twin';
    this.dot.dataset['line'] = model.line;
    this.dot.title = LINES[model.line];
    this.enter.textContent = xr.ar ? 'Enter AR' : xr.vr ? 'Enter VR' : 'No headset found';
    this.enter.disabled = !(xr.ar || xr.vr) || xr.presenting;
    this.other.textContent = 'Enter VR';
    this.other.hidden = !(xr.ar && xr.vr);
    this.about.textContent = xr.text;
    this.headline.refresh();
    this.tasks.refresh();
    this.coach.refresh();
    if (this.app.console) this.help.textContent = this.app.console.help;
    document.documentElement.toggleAttribute('data-console', this.app.console !== null);
    this.help.hidden = model.status().tone !== 'plain'; // a warning needs the space
  }
}
