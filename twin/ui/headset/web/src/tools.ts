/** The window of tools: which tool each instrument holds, and which end of the instruments the hands move. */

import type { App } from './app';
import type { Console } from './console';
import { SIDES } from './pens';
import type { Side, ToolInfo } from './protocol';

const SVG = 'http://www.w3.org/2000/svg';

/** Drawing of each kind of tool in a box of 64 x 24: its shaft comes from the left. */
const DRAWN: Readonly<Record<ToolInfo['kind'], string>> = {
  grasper: 'M0 12H30M30 12Q38 3 56 6M34 9l3 3 3-4 3 3 3-4 3 3 3-3M30 12Q38 21 56 18M34 15l3-3 3 4 3-3 3 4 3-3 3 3',
  scissors: 'M0 12H30M28 12L60 4Q50 13 32 14ZM28 12L60 20Q50 11 32 10Z',
  clip_applier: 'M0 12H26M26 12Q30 4 40 5H58V9H40M26 12Q30 20 40 19H58V15H40',
  scalpel: 'M0 12H28M28 8H40L62 12Q52 18 40 16H28Z',
  cautery: 'M0 12H34M34 9H40V15H34ZM40 12H56V20H50',
};

const make = <K extends keyof HTMLElementTagNameMap>(tag: K, cls = '', text = ''): HTMLElementTagNameMap[K] => {
  const node = document.createElement(tag);
  if (cls) node.className = cls;
  if (text) node.textContent = text;
  return node;
};

export class Tools {
  private readonly window = make('section', 'tools');
  private readonly buttons: { side: Side; tool: ToolInfo; node: HTMLButtonElement }[] = [];
  private readonly does: Record<Side, HTMLElement> = { right: make('p'), left: make('p') };
  private readonly fulcrum = make('button');
  private shown = '';

  constructor(
    parent: HTMLElement,
    private readonly app: App,
    private readonly console: Console,
  ) {
    this.window.dataset['id'] = 'tools';
    this.window.setAttribute('aria-label', 'Tools');
    this.fulcrum.dataset['id'] = 'fulcrum-window';
    this.fulcrum.title = 'Choose whether the hands move the tips or the outer ends of the instruments';
    this.fulcrum.onclick = () => console.toggleFulcrum();
    const head = make('h2', '', 'Tools');
    head.append(this.fulcrum);
    this.window.append(head, ...SIDES.toReversed().map((side) => this.row(side)));
    parent.append(this.window);
  }

  /** Show the chosen tools, beside or above the small picture; called with the other controls. */
  refresh(): void {
    const { views, info } = this.console;
    const state = this.app.model.console;
    const box = views.beside;
    const now = JSON.stringify([box, this.app.xr.presenting, state?.fulcrum, SIDES.map((s) => state?.hands[s])]);
    if (now === this.shown) return;
    this.shown = now;
    this.window.classList.toggle('low', box.height < 150); // no room for drawings
    this.window.classList.toggle('flat', box.height < 110 || views.flat); // only for the buttons
    for (const [key, value] of Object.entries(box)) this.window.style.setProperty(key, `${value}px`);
    for (const { side, tool, node } of this.buttons)
      {
        node.setAttribute('aria-pressed', String(state?.hands[side]?.tool === tool.name));
        node.classList.toggle('carried', state?.hands[side]?.carries === tool.name);
      }
    for (const side of SIDES) {
      const chosen = info.tools.find((t) => t.name === state?.hands[side]?.tool);
      const hand = state?.hands[side];
      const doing = hand?.active ? 'is switched on' : (chosen?.does ?? '');
      this.does[side].textContent = `${side === 'right' ? 'Right' : 'Left'} hand: ${hand?.waits ?? (chosen ? `${chosen.title} – ${doing}` : '')}`;
      this.does[side].dataset['tone'] = hand?.waits ? 'warn' : hand?.active ? 'bad' : 'plain';
    }
    this.fulcrum.textContent = this.console.fulcrumText();
    this.fulcrum.setAttribute('aria-pressed', String(state?.fulcrum === 'direct'));
  }

  private row(side: Side): HTMLElement {
    const row = make('div', 'tool-row');
    row.dataset['side'] = side;
    for (const tool of this.console.info.tools) {
      const node = make('button', 'tool');
      node.dataset['id'] = `tool-${side}-${tool.name}`;
      node.title = `${tool.title}: ${tool.does}`;
      node.append(drawing(tool.kind), make('span', '', tool.title));
      node.onclick = () => this.console.takeTool(side, tool.name);
      this.buttons.push({ side, tool, node });
      row.append(node);
    }
    const whole = make('div', 'tool-hand');
    whole.append(this.does[side], row);
    return whole;
  }
}

function drawing(kind: ToolInfo['kind']): SVGElement {
  const svg = document.createElementNS(SVG, 'svg');
  svg.setAttribute('viewBox', '0 0 64 24');
  svg.setAttribute('aria-hidden', 'true');
  const path = document.createElementNS(SVG, 'path');
  path.setAttribute('d', DRAWN[kind]);
  svg.append(path);
  return svg;
}
