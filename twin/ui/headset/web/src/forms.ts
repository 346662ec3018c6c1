/**
 * The questionnaire that a study asks now, before the first attempt at a task or after an attempt: over the page, and in a
 * headset as a tab of the panel. Both show the same answers.
 */

import type { App } from './app';
import type { Control, Tab } from './controls';
import type { QuestionnaireInfo } from './protocol';

const make = <K extends keyof HTMLElementTagNameMap>(tag: K, cls = '', text = ''): HTMLElementTagNameMap[K] => {
  const node = document.createElement(tag);
  if (cls) node.className = cls;
  if (text) node.textContent = text;
  return node;
};

/** Largest number of answers that have a button each; more answers have a slider. */
const BUTTONS = 7;

/** Text of an item that is not answered. */
const OPEN = '–';

export class Forms {
  private readonly card = make('form', 'card form');
  private shown = '';
  /** Whether the questionnaire that is shown is asked before or after the task; '': none is shown. */
  private when = '';
  /** Answers by item; null: none yet. */
  private answers: (number | null)[] = [];
  /** Why the answers cannot be sent; '': they can. */
  private wrong = '';
  /** Whether answers are on their way: a second click answers no second form. */
  private sending = false;
  private left = 0;
  private inHeadset = false;
  /** The chosen item of each pair of items; null: none yet. */
  private pairs: { items: readonly [number, number]; chosen: number | null }[] = [];

  constructor(
    parent: HTMLElement,
    private readonly app: App,
    private readonly asked: readonly QuestionnaireInfo[],
  ) {
    this.card.dataset['id'] = 'form';
    this.card.hidden = true;
    this.card.onsubmit = (e) => {
      e.preventDefault();
      this.send();
    };
    // Keys of a form move no hand. The release of a key passes: it may have been pressed before the form had the focus.
    this.card.addEventListener('keydown', (e) => e.stopPropagation());
    parent.append(this.card);
  }

  /** Show the questionnaire that is asked now; called for each state. */
  refresh(): void {
    const form = this.app.model.console?.form ?? null;
    const now = JSON.stringify(form);
    const key = this.key;
    if (now !== this.shown) {
      this.shown = now;
      this.card.hidden = !form || !key;
      if (form && key) {
        this.begin(key, form.when, form.left);
        this.build(key);
      }
      const tab = this.tab();
      this.app.showPanel(tab);
      if (tab) this.app.xrPanel.choose(tab.id);
    }
    // Answers that were given in the headset are on the page afterwards.
    if (this.inHeadset && !this.app.xr.presenting && key) this.build(key);
    this.inHeadset = this.app.xr.presenting;
  }

  /** Where to answer the questionnaire that is due; null: none is due. */
  get due(): string | null {
    if (!this.key) return null;
    return `Answer the questionnaire ${this.app.xr.presenting ? 'on the panel' : 'on the page'}: the hands are at rest until then.`;
  }

  private get key(): QuestionnaireInfo | undefined {
    return this.asked.find((k) => k.name === this.app.model.console?.form?.name);
  }

  private begin(key: QuestionnaireInfo, when: string, left: number): void {
    this.when = when;
    this.left = left;
    this.wrong = '';
    this.sending = false;
    this.answers = key.items.map(() => null);
    this.pairs = [];
    if (key.pairs)
      for (let i = 0; i < key.items.length; i++)
        for (let j = i + 1; j < key.items.length; j++) this.pairs.push({ items: [i, j], chosen: null });
  }

  private headText(key: QuestionnaireInfo): string {
    const more = this.left > 1 ? `, ${this.left - 1} more` : '';
    return `${this.when === 'before' ? 'Before' : 'After'} the task${more}. From ${key.ends[0]} to ${key.ends[1]}.`;
  }

  /** Return the values of an item that have a button each; null: there are too many. */
  private values(key: QuestionnaireInfo): number[] | null {
    const count = Math.round((key.high - key.low) / key.step) + 1;
    return count <= BUTTONS ? Array.from({ length: count }, (_, i) => key.low + i * key.step) : null;
  }

  private build(key: QuestionnaireInfo): void {
    const nodes: HTMLElement[] = [make('h2', '', key.title), make('p', '', this.headText(key))];
    key.items.forEach((item, k) => nodes.push(this.item(key, item, k)));
    if (key.pairs) nodes.push(this.comparisons(key));
    const done = make('button', 'enter', 'Done');
    done.dataset['id'] = 'form-done';
    done.disabled = this.sending;
    nodes.push(make('p', 'wrong', this.wrong), done);
    this.card.replaceChildren(...nodes);
  }

  private item(key: QuestionnaireInfo, item: string, k: number): HTMLElement {
    const field = make('fieldset');
    field.append(make('legend', '', item));
    const answer = this.answers[k] ?? null;
    const values = this.values(key);
    if (values) {
      for (const value of values)
        field.append(this.choice(`item-${k}`, String(value), value === answer, () => (this.answers[k] = value)));
      return field;
    }
    const slider = make('input');
    const at = answer ?? (key.low + key.high) / 2;
    Object.assign(slider, { type: 'range', min: String(key.low), max: String(key.high), step: String(key.step), value: String(at) });
    slider.setAttribute('aria-label', item);
    slider.dataset['id'] = `item-${k}`;
    const said = make('output', '', answer === null ? OPEN : String(answer));
    slider.oninput = () => {
      this.answers[k] = Number(slider.value);
      said.textContent = slider.value;
    };
    field.append(slider, said);
    return field;
  }

  private comparisons(key: QuestionnaireInfo): HTMLElement {
    const all = make('details');
    all.append(make('summary', '', this.weightsText));
    this.pairs.forEach((pair, k) => {
      const field = make('fieldset');
      for (const i of pair.items)
        field.append(this.choice(`pair-${k}`, key.items[i] as string, pair.chosen === i, () => (pair.chosen = i)));
      all.append(field);
    });
    return all;
  }

  private get weightsText(): string {
    return `Weights: in each of ${this.pairs.length} pairs, choose what counted more (all or none)`;
  }

  private choice(name: string, text: string, chosen: boolean, choose: () => void): HTMLElement {
    const label = make('label');
    const button = make('input');
    Object.assign(button, { type: 'radio', name, value: text, checked: chosen });
    button.onchange = choose;
    label.append(button, text);
    return label;
  }

  /** Send the answers; items may stay open, pairs are compared all or none. */
  private send(): void {
    const { key, when } = this;
    if (!key || !when || this.sending) return;
    const chosen = this.pairs.filter((p) => p.chosen !== null).length;
    if (chosen > 0 && chosen < this.pairs.length) {
      this.say(`${this.pairs.length - chosen} of ${this.pairs.length} pairs are not compared yet: compare all or none.`);
      return;
    }
    this.say('');
    const weights = chosen ? key.items.map((_, i) => this.pairs.filter((p) => p.chosen === i).length) : null;
    this.wait(true);
    void this.app.ask('form', { when, name: key.name, answers: this.answers, weights }).then((ok) => {
      if (!ok) this.wait(false);
    });
  }

  private say(wrong: string): void {
    this.wrong = wrong;
    (this.card.querySelector('.wrong') as HTMLElement).textContent = wrong;
  }

  private wait(on: boolean): void {
    this.sending = on;
    const done = this.card.querySelector<HTMLButtonElement>('[data-id=form-done]');
    if (done) done.disabled = on;
  }

  /** Return the questionnaire as a tab of the panel in the headset; null: none is due. */
  tab(): Tab | null {
    const { key } = this;
    if (!key) return null;
    const controls: Control[] = [
      { kind: 'head', text: key.title },
      { kind: 'text', id: 'form-head', text: () => this.headText(key) },
      ...key.items.map((item, k) => this.itemControl(key, item, k)),
    ];
    if (this.pairs.length) controls.push({ kind: 'text', id: 'form-weights', text: () => this.weightsText });
    this.pairs.forEach((pair, k) =>
      controls.push({
        kind: 'row',
        items: pair.items.map((i, at) => ({
          kind: 'button',
          id: `pair-${k}-${at}`,
          label: () => key.items[i] as string,
          hint: 'The item that mattered more',
          on: () => pair.chosen === i,
          press: () => (pair.chosen = i),
        })),
      }),
    );
    controls.push(
      { kind: 'text', id: 'form-wrong', text: () => this.wrong, tone: () => 'bad' },
      {
        kind: 'button',
        id: 'form-done',
        label: () => 'Done',
        hint: 'Send the answers',
        off: () => this.sending,
        press: () => this.send(),
      },
    );
    return { id: 'form', label: 'Questionnaire', hint: 'Questions that are asked now', controls };
  }

  private itemControl(key: QuestionnaireInfo, item: string, k: number): Control {
    const id = `item-${k}`;
    const answer = () => this.answers[k] ?? null;
    const values = this.values(key);
    if (values)
      return {
        kind: 'choice',
        id,
        label: item,
        hint: `${key.ends[0]} … ${key.ends[1]}`,
        options: () => [['', OPEN], ...values.map((v): [string, string] => [String(v), String(v)])],
        get: () => String(answer() ?? ''),
        set: (value) => (this.answers[k] = value === '' ? null : Number(value)),
      };
    return {
      kind: 'slider',
      id,
      label: item,
      hint: `${key.ends[0]} … ${key.ends[1]}`,
      range: () => [key.low, key.high],
      get: () => answer() ?? (key.low + key.high) / 2,
      set: (value) => (this.answers[k] = key.low + key.step * Math.round((value - key.low) / key.step)),
      show: () => String(answer() ?? OPEN),
    };
  }
}
