/** The questionnaire that a study asks now, before the first attempt at a task or after an attempt, over the page. */

import type { App } from './app';
import type { QuestionnaireInfo } from './protocol';

const make = <K extends keyof HTMLElementTagNameMap>(tag: K, cls = '', text = ''): HTMLElementTagNameMap[K] => {
  const node = document.createElement(tag);
  if (cls) node.className = cls;
  if (text) node.textContent = text;
  return node;
};

/** Largest number of answers that have a button each; more answers have a slider. */
const BUTTONS = 7;

export class Forms {
  private readonly card = make('form', 'card form');
  private shown = '';
  /** Whether the questionnaire that is shown is asked before or after the task; '': none is shown. */
  private when = '';
  /** Answers by item; null: none yet. */
  private answers: (number | null)[] = [];
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
    if (now === this.shown) return;
    this.shown = now;
    const key = this.asked.find((k) => k.name === form?.name);
    this.card.hidden = !form || !key;
    if (form && key) this.build(key, form.when, form.left);
  }

  private get key(): QuestionnaireInfo | undefined {
    return this.asked.find((k) => k.name === this.app.model.console?.form?.name);
  }

  private build(key: QuestionnaireInfo, when: string, left: number): void {
    this.when = when;
    this.answers = key.items.map(() => null);
    this.pairs = [];
    if (key.pairs)
      for (let i = 0; i < key.items.length; i++)
        for (let j = i + 1; j < key.items.length; j++) this.pairs.push({ items: [i, j], chosen: null });
    const more = left > 1 ? `, ${left - 1} more` : '';
    const head = make('p', '', `${when === 'before' ? 'Before' : 'After'} the task${more}. From ${key.ends[0]} to ${key.ends[1]}.`);
    const nodes: HTMLElement[] = [make('h2', '', key.title), head];
    key.items.forEach((item, k) => nodes.push(this.item(key, item, k)));
    if (key.pairs) nodes.push(this.comparisons(key));
    const done = make('button', 'enter', 'Done');
    done.dataset['id'] = 'form-done';
    nodes.push(make('p', 'wrong'), done);
    this.card.replaceChildren(...nodes);
  }

  private item(key: QuestionnaireInfo, item: string, k: number): HTMLElement {
    const field = make('fieldset');
    field.append(make('legend', '', item));
    const count = (key.high - key.low) / key.step + 1;
    if (count <= BUTTONS) {
      for (let value = key.low; value <= key.high; value += key.step)
        field.append(this.choice(`item-${k}`, String(value), () => (this.answers[k] = value)));
      return field;
    }
    const slider = make('input');
    Object.assign(slider, { type: 'range', min: String(key.low), max: String(key.high), step: String(key.step), value: String((key.low + key.high) / 2) });
    slider.setAttribute('aria-label', item);
    slider.dataset['id'] = `item-${k}`;
    const said = make('output', '', '–');
    slider.oninput = () => {
      this.answers[k] = Number(slider.value);
      said.textContent = slider.value;
    };
    field.append(slider, said);
    return field;
  }

  private comparisons(key: QuestionnaireInfo): HTMLElement {
    const all = make('details');
    all.append(make('summary', '', `Weights: in each of ${this.pairs.length} pairs, choose what counted more (all or none)`));
    this.pairs.forEach((pair, k) => {
      const field = make('fieldset');
      for (const i of pair.items) field.append(this.choice(`pair-${k}`, key.items[i] as string, () => (pair.chosen = i)));
      all.append(field);
    });
    return all;
  }

  private choice(name: string, text: string, choose: () => void): HTMLElement {
    const label = make('label');
    const button = make('input');
    Object.assign(button, { type: 'radio', name, value: text });
    button.onchange = choose;
    label.append(button, text);
    return label;
  }

  /** Send the answers; items may stay open, pairs are compared all or none. */
  private send(): void {
    const { key, when } = this;
    const done = this.card.querySelector<HTMLButtonElement>('[data-id=form-done]');
    if (!key || !when || !done || done.disabled) return;
    const wrong = this.card.querySelector('.wrong') as HTMLElement;
    const chosen = this.pairs.filter((p) => p.chosen !== null).length;
    if (chosen > 0 && chosen < this.pairs.length) {
      wrong.textContent = `${this.pairs.length - chosen} of ${this.pairs.length} pairs are not compared yet: compare all or none.`;
      return;
    }
    wrong.textContent = '';
    const weights = chosen ? key.items.map((_, i) => this.pairs.filter((p) => p.chosen === i).length) : null;
    done.disabled = true; // until the answer: a second click answers no second form
    void this.app.ask('form', { when, name: key.name, answers: this.answers, weights }).then((ok) => {
      if (!ok) done.disabled = false;
    });
  }
}
