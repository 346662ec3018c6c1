/** The controls next to the picture, as elements of the page. */

import type { Button, Choice, Control, Drawer, Sheet, Slider, Tab } from './controls';

const make = <K extends keyof HTMLElementTagNameMap>(tag: K, cls = '', text = ''): HTMLElementTagNameMap[K] => {
  const node = document.createElement(tag);
  if (cls) node.className = cls;
  if (text) node.textContent = text;
  return node;
};

export class DomPanel implements Drawer {
  readonly side = make('section', 'side');
  readonly foot = make('section', 'foot');
  private updates: (() => void)[] = [];
  private lost: () => boolean = () => false;
  private open = 'simulation';
  /** Whether only the tab headings are shown: initially on a small screen at a console, or beside the board of a procedure. */
  private folded = false;
  private folds = false;
  private shown = false;
  private readonly fold = make('button', 'tab fold');
  private readonly small = window.matchMedia('(max-width: 760px), (max-height: 480px)');
  private readonly narrow = window.matchMedia('(max-width: 1400px)');
  private readonly bodies = new Map<string, HTMLElement>();
  private readonly heads = new Map<string, HTMLButtonElement>();

  constructor(parent: HTMLElement) {
    this.side.setAttribute('aria-label', 'Controls');
    parent.append(this.side, this.foot);
    // The height of the bar depends on its text and on the window; what is above it follows.
    const follow = () => document.documentElement.style.setProperty('--foot', `${this.foot.offsetHeight}px`);
    new ResizeObserver(follow).observe(this.foot);
    // The controls of a window that becomes small are folded, as in a window that is small at the start.
    for (const size of [this.small, this.narrow])
      size.addEventListener('change', () => {
        this.folded = this.first();
        this.choose(this.open);
      });
    this.fold.dataset['id'] = 'fold';
    this.fold.onclick = () => {
      this.folded = !this.folded;
      this.choose(this.open);
    };
  }

  show(sheet: Sheet): void {
    this.updates = [];
    const before = this.heads.has('console');
    this.folds = sheet.folds ?? false;
    this.lost = sheet.lost;
    this.side.replaceChildren();
    this.bodies.clear();
    this.heads.clear();
    this.foot.replaceChildren();
    const bar = make('div', 'tabs');
    const heads = make('div', 'tab-list');
    heads.setAttribute('role', 'tablist');
    bar.append(heads);
    this.side.append(bar);
    for (const tab of sheet.tabs) {
      const head = make('button', 'tab', tab.label);
      head.setAttribute('role', 'tab');
      head.dataset['id'] = `tab-${tab.id}`;
      head.title = tab.hint;
      head.onclick = () => {
        this.folded = this.small.matches && tab.id === this.open && !this.folded;
        this.choose(tab.id);
      };
      heads.append(head);
      this.heads.set(tab.id, head);
      const body = make('div', 'body');
      body.tabIndex = 0; // so that keys can scroll a long tab
      body.setAttribute('role', 'tabpanel');
      body.setAttribute('aria-label', tab.label);
      body.append(...this.drawAll(tab));
      this.bodies.set(tab.id, body);
      this.side.append(body);
    }
    bar.append(this.fold);
    if (!this.shown || (this.heads.has('console') && !before)) this.folded = this.first();
    this.shown = true;
    this.foot.append(this.draw(sheet.status), ...sheet.transport.map((c) => this.draw(c)));
    this.choose(this.bodies.has(this.open) ? this.open : (sheet.tabs[0]?.id ?? ''));
    this.refresh();
  }

  refresh(): void {
    for (const update of this.updates) update();
  }

  /** Pixels that the controls cover at the right and at the bottom; folded, they cover only a corner, which does not count. */
  covers(): [right: number, bottom: number] {
    const [w, h] = [window.innerWidth, window.innerHeight];
    const halves = 'halves' in document.documentElement.dataset; // the page has half its width then, see halves.ts
    const left = (halves ? 2 : 1) * this.side.getBoundingClientRect().left;
    const beside = left > w / 2;
    return [beside && !this.folded ? w - left : 0, h - (beside ? this.foot : this.side).getBoundingClientRect().top];
  }

  /** Left edge in pixels of the tabs, if they are at the top of the page. */
  get left(): number {
    const { left, top } = this.side.getBoundingClientRect();
    return top < window.innerHeight / 4 ? left : window.innerWidth;
  }

  /** Whether the controls are folded until somebody opens them: on a small screen they would hide the robot. */
  private first(): boolean {
    return this.small.matches || (this.heads.has('console') && this.folds && this.narrow.matches);
  }

  private choose(id: string): void {
    this.open = id;
    this.fold.textContent = this.folded ? '▾' : '▴';
    this.fold.title = this.folded ? 'Show the controls' : 'Hide the controls';
    this.fold.setAttribute('aria-label', this.fold.title);
    this.fold.setAttribute('aria-expanded', String(!this.folded));
    for (const [name, body] of this.bodies) body.hidden = this.folded || name !== id;
    for (const [name, head] of this.heads) head.setAttribute('aria-selected', String(!this.folded && name === id));
  }

  private drawAll(tab: Tab): HTMLElement[] {
    return tab.controls.map((c) => this.draw(c));
  }

  private draw(c: Control): HTMLElement {
    switch (c.kind) {
      case 'head': {
        const node = make('h2', '', c.text);
        this.showIf(node, c.shown);
        return node;
      }
      case 'text': {
        const node = make('p', 'text');
        node.dataset['id'] = c.id;
        if (c.id === 'status') node.setAttribute('role', 'status');
        this.on(
          () => `${c.tone?.() ?? 'plain'}|${c.text()}`,
          () => {
            node.textContent = c.text();
            node.dataset['tone'] = c.tone?.() ?? 'plain';
            node.hidden = !c.text();
          },
        );
        return node;
      }
      case 'button':
        return this.button(c);
      case 'row': {
        const node = make('div', 'row');
        node.append(...c.items.map((b) => this.button(b)));
        this.showIf(node, c.shown);
        return node;
      }
      case 'choice':
        return this.choice(c);
      case 'slider':
        return this.slider(c);
    }
  }

  /** Show a node only while `shown` is true; always without it. */
  private showIf(node: HTMLElement, shown?: () => boolean): void {
    if (!shown) return;
    this.on(
      () => String(shown()),
      () => (node.hidden = !shown()),
    );
  }

  private button(c: Button): HTMLElement {
    const node = make('button', 'push');
    node.dataset['id'] = c.id;
    node.title = c.hint;
    const { lost } = this;
    node.onclick = () => c.press();
    this.on(
      () => `${c.label()}|${c.on?.() ?? ''}|${c.off?.() ?? ''}|${lost()}`,
      () => {
        node.textContent = c.label();
        node.disabled = lost() || (c.off?.() ?? false);
        if (c.on) node.setAttribute('aria-pressed', String(c.on()));
      },
    );
    return node;
  }

  private choice(c: Choice): HTMLElement {
    const label = make('label', 'field', c.label);
    label.title = c.hint;
    const { lost } = this;
    const node = make('select');
    node.dataset['id'] = c.id;
    label.append(node);
    node.onchange = () => c.set(node.value);
    this.on(
      () => JSON.stringify([c.options(), c.get(), lost()]),
      () => {
        node.replaceChildren(
          ...c.options().map(([value, text]) => {
            const option = make('option', '', text);
            option.value = value;
            return option;
          }),
        );
        node.value = c.get();
        node.disabled = lost();
      },
    );
    return label;
  }

  private slider(c: Slider): HTMLElement {
    const box = make('div', 'slider');
    const label = make('label', 'field');
    label.title = c.hint;
    const { lost } = this;
    const name = make('span', 'name', c.label);
    const value = make('output', 'value');
    const bar = make('input');
    bar.type = 'range';
    bar.step = 'any';
    bar.dataset['id'] = c.id;
    bar.setAttribute('aria-label', c.label); // the bar below the picture does not show the name
    label.append(name, value, bar);
    box.append(label);
    let held = false;
    const begin = () => {
      if (!held) c.begin?.();
      held = true;
    };
    const end = () => {
      if (held) c.end?.();
      held = false;
    };
    bar.onpointerdown = begin;
    bar.oninput = () => {
      const short = !held; // changed by a key: grab, set and release at once
      begin();
      c.set(bar.valueAsNumber);
      if (short) end();
    };
    bar.onpointerup = bar.onpointercancel = bar.onlostpointercapture = end;
    if (c.segments) box.prepend(this.segments(c));
    this.on(
      () => `${c.range().join()}|${c.get()}|${c.off?.() ?? ''}|${lost()}`,
      () => {
        const [low, high] = c.range();
        bar.min = String(low);
        bar.max = String(high);
        if (!held) bar.value = String(c.get());
        bar.disabled = lost() || (c.off?.() ?? false);
        value.textContent = c.show(c.get());
        bar.setAttribute('aria-valuetext', c.show(c.get()));
      },
    );
    return box;
  }

  /** Phases above the time slider, with widths proportional to their durations. */
  private segments(c: Slider): HTMLElement {
    const strip = make('div', 'phases');
    this.on(
      () => JSON.stringify(c.segments?.()),
      () => {
        const [low, high] = c.range();
        strip.replaceChildren(
          ...(c.segments?.() ?? []).map(([name, a, b]) => {
            const node = make('button', 'phase', name);
            node.title = `${name}: ${a.toFixed(2)}–${b.toFixed(2)} s`;
            node.style.left = `${(100 * (a - low)) / (high - low)}%`;
            node.style.width = `${(100 * (b - a)) / (high - low)}%`;
            node.onclick = () => c.set(a);
            node.dataset['start'] = String(a);
            return node;
          }),
        );
      },
    );
    this.on(
      () => String(c.get()),
      () => {
        const t = c.get();
        const all = [...strip.children] as HTMLElement[];
        const spans = c.segments?.() ?? [];
        all.forEach((node, i) =>
          node.toggleAttribute('data-now', t >= (spans[i]?.[1] ?? 0) && t < (spans[i]?.[2] ?? 0)),
        );
      },
    );
    return strip;
  }

  /** Call a function when the value that it depends on has changed. */
  private on(key: () => string, act: () => void): void {
    let last: string | null = null;
    this.updates.push(() => {
      const now = key();
      if (now === last) return;
      last = now;
      act();
    });
  }
}
