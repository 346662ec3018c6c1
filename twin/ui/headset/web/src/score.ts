/** The scoreboard of a task beside the endoscope's picture, and the card with the result at its end. */

import type { App } from './app';
import type { Control } from './controls';
import type { TaskState } from './protocol';
import type { Views } from './views';

const make = <K extends keyof HTMLElementTagNameMap>(tag: K, cls = '', text = ''): HTMLElementTagNameMap[K] => {
  const node = document.createElement(tag);
  if (cls) node.className = cls;
  if (text) node.textContent = text;
  return node;
};

type Place = Readonly<Record<string, number | string>>;

export class Score {
  private readonly board = make('section', 'score');
  private readonly card = make('section', 'card');
  private shown = '';
  private around = '';

  constructor(
    parent: HTMLElement,
    private readonly app: App,
  ) {
    this.board.dataset['id'] = 'score';
    this.board.setAttribute('aria-label', 'Scoreboard');
    this.card.dataset['id'] = 'result';
    this.card.setAttribute('role', 'status');
    this.board.hidden = this.card.hidden = true;
    parent.append(this.board, this.card);
  }

  refresh(): void {
    const task = this.app.model.console?.task ?? null;
    const now = JSON.stringify(task);
    this.board.classList.toggle('guided', Boolean(task?.stages));
    const placed = this.place();
    if (now === this.shown) {
      if (placed) this.fit();
      return;
    }
    this.shown = now;
    this.board.hidden = !task || task.over !== null; // the card at the end has the same rows
    this.card.hidden = !task?.over;
    if (!task) return;
    this.app.objects.number(task.rings.map(([name]) => name));
    this.board.replaceChildren(make('h2', '', task.title), ...next(task), ...body(task));
    this.fit();
    if (task.over)
      this.card.replaceChildren(make('h2', '', task.over), stages(task), rows(task), this.report(task), this.again());
  }

  /**
   * Place the board so that it hides little of the endoscope's picture; return whether its place has changed. A board
   * with the stages of a procedure is above the windows at the bottom. Other boards are beside the small picture or, if
   * the page is narrow, above it.
   */
  private place(): boolean {
    const views = this.app.console?.views;
    const guided = this.board.classList.contains('guided');
    const box = views && !guided ? across(views) : this.column(views);
    const now = JSON.stringify(box);
    if (now === this.around) return false;
    this.around = now;
    this.board.classList.toggle('across', views !== undefined && !guided);
    const narrow = window.matchMedia('(max-width: 760px)').matches;
    this.board.classList.toggle('top', views !== undefined && guided && (narrow || views.low < views.corner.top));
    for (const key of ['top', 'bottom', 'left', 'width', 'min-width', 'max-height']) {
      const value = box[key];
      if (value === undefined) this.board.style.removeProperty(key);
      else this.board.style.setProperty(key, typeof value === 'number' ? `${value}px` : value);
    }
    return true;
  }

  /** Width in pixels that the board covers at the left; 0 if it spans the width. */
  covers(): number {
    const beside = this.board.matches('.guided:not(.top):not([hidden])');
    return beside ? Math.round(this.board.getBoundingClientRect().right) : 0;
  }

  private column(views?: Views): Place {
    const low = document.querySelector('header')?.getBoundingClientRect().bottom ?? 0;
    const top = Math.round(low) + 10;
    const high = Math.max(0, (views?.low ?? window.innerHeight) - top - 10);
    return { top, 'max-height': high, 'min-width': views?.corner.width ?? 0 };
  }

  /**
   * If there is no space, hide old events, measures from the last, the newest event, done stages, title; cut no line. A
   * board without stages first hides the next step, which the status line also shows.
   */
  private fit(): void {
    const all = (what: string) => [...this.board.querySelectorAll<HTMLElement>(what)];
    const events = all('.events li').reverse();
    const done = all('.stages [data-state="done"]');
    const views = this.app.console?.views;
    if (views) views.high = this.board.matches('.top:not([hidden])') ? this.board.getBoundingClientRect().bottom : 0;
    const step = this.board.matches('.guided') ? [] : all('.next');
    const spare = [...step, ...events.slice(0, -1), ...all('tr').reverse(), ...events.slice(-1), ...done, ...all('h2')];
    for (const row of spare) row.hidden = false;
    for (const row of spare) {
      if (this.board.scrollHeight <= this.board.clientHeight) break;
      row.hidden = true;
    }
  }

  private report(task: TaskState): HTMLElement {
    const { report } = task;
    if (!report || report.attempt !== task.attempt) return make('p', '', 'This attempt has no report.');
    if (report.problem) return make('p', 'wrong', `There is no report: ${report.problem}`);
    if (!report.ready) return make('p', '', 'The report is being made: the session is replayed and measured …');
    const link = make('a', '', 'Open the report');
    link.href = `report-${report.attempt}.html`;
    link.target = '_blank';
    link.dataset['id'] = 'report';
    return link;
  }

  private again(): HTMLElement {
    const button = make('button', 'enter', 'Restart');
    button.dataset['id'] = 'again';
    button.onclick = () => this.app.ask('task', { do: 'restart' });
    return button;
  }
}

/** Return the place of a board of two columns beside the small picture, or above it if the page is narrow. */
function across(views: Views): Place {
  const { corner } = views;
  const [right] = views.free;
  const left = corner.left + corner.width + 12;
  const low = corner.top + corner.height - (views.flat ? 0 : 26); // above the text of help
  const width = Math.min(right - left - 12, views.flat ? 700 : 540);
  if (width >= 380) return { left, width, top: 'auto', bottom: window.innerHeight - low, 'max-height': low - corner.top + 60 };
  const bottom = window.innerHeight - corner.top + 10;
  return { left: corner.left, width: right - 2 * corner.left, top: 'auto', bottom, 'max-height': corner.top / 2 };
}

function rows(task: TaskState): HTMLElement {
  const table = make('table');
  for (const [what, value] of task.rows) {
    const row = make('tr');
    row.append(make('td', '', what), make('td', 'value', value));
    table.append(row);
  }
  return table;
}

/** Return what the task needs next. */
function next(task: TaskState): HTMLElement[] {
  if (!task.next || task.over) return [];
  const node = make('p', 'next', task.next);
  node.dataset['id'] = 'next';
  return [node];
}

/** Return the parts of the board: the events of a procedure are above its stages, so that they are always visible. */
function body(task: TaskState): HTMLElement[] {
  if (task.stages) return [events(task), stages(task), rows(task)];
  return [rows(task), rings(task), events(task)];
}

const MARK = { done: '✓', open: '○', failed: '✗' } as const;

/** Return the stages of a procedure, with the measured value of failed stages; at the end, open stages have failed. */
function stages(task: TaskState): HTMLElement {
  const list = make('ul', 'stages');
  for (const [title, state, text] of task.stages ?? []) {
    const shown = task.over && state === 'open' ? 'failed' : state;
    const item = make('li', '', `${MARK[shown]} ${title}`);
    item.dataset['state'] = shown;
    if (shown === 'failed') item.append(make('small', '', text));
    list.append(item);
  }
  return list;
}

/** Return a name of a file as words: "ring1" as "ring 1". */
const spoken = (name: string): string => name.replaceAll('_', ' ').replace(/(?<=[a-z])(?=\d+$)/, ' ');

function rings(task: TaskState): HTMLElement {
  const list = make('ul', 'rings');
  for (const [name, state, color] of task.rings) {
    const item = make('li', '', `${spoken(name)}: ${state}`);
    const dot = make('span', 'ring');
    dot.style.borderColor = color;
    item.prepend(dot);
    list.append(item);
  }
  return list;
}

function events(task: TaskState): HTMLElement {
  const list = make('ol', 'events');
  for (const [t, tone, text] of task.events.toReversed()) {
    const item = make('li', '', `${t.toFixed(1)} s  ${text}`);
    item.dataset['tone'] = tone;
    list.append(item);
  }
  return list;
}

/** Return the tone of the message at the end of a task: good if it is a procedure that has passed all its checks. */
export function endTone(task: TaskState): 'good' | 'plain' {
  return task.stages?.every(([, state]) => state === 'done') ? 'good' : 'plain';
}

/** Return the controls of a task that are always visible; the headset has no scoreboard besides them. */
export function taskControls(app: App): Control[] {
  const task = () => app.model.console?.task ?? null;
  return [
    {
      kind: 'text',
      id: 'task-line',
      text: () => {
        const now = task();
        if (!now) return '';
        const last = now.next ?? now.events.at(-1)?.[2] ?? '';
        return `${now.rows.map(([what, value]) => `${what}: ${value}`).join(' · ')}\n${now.over ?? last}`;
      },
      tone: () => {
        const now = task();
        if (now?.over) return endTone(now);
        return now?.events.at(-1)?.[1] === 'bad' ? 'bad' : 'plain';
      },
    },
    {
      kind: 'row',
      items: [
        {
          kind: 'button',
          id: 'task-end',
          label: () => 'End the task',
          off: () => task()?.over !== null,
          press: () => app.ask('task', { do: 'end' }),
          hint: 'Stop here, and show the result',
        },
        {
          kind: 'button',
          id: 'task-restart',
          label: () => 'Restart',
          press: () => app.ask('task', { do: 'restart' }),
          hint: 'Begin a new attempt, with instruments, objects and measures as at the start',
        },
      ],
    },
  ];
}
