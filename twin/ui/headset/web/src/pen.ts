/** Draws the parts of the floating panel on a canvas. */

import type { Tone } from './controls';
import type { Look } from './world';

interface Colors {
  paper: string;
  edge: string;
  ink: string;
  faint: string;
  button: string;
  hot: string;
  on: string;
  onInk: string;
  good: string;
  warn: string;
  bad: string;
}

export interface Box {
  x: number;
  y: number;
  w: number;
  h: number;
}

const NORMAL: Colors = {
  paper: '#f7f9fcf2',
  edge: '#b9c4d1',
  ink: '#17212e',
  faint: '#55616f',
  button: '#e3e9f1',
  hot: '#c9dbf3',
  on: '#2268c9',
  onInk: '#ffffff',
  good: '#0c7a43',
  warn: '#9a5200',
  bad: '#b3101e',
};

/** No colour is nearly black, because black is transparent on an additive display. */
const BRIGHT: Colors = {
  paper: '#eaf3ff',
  edge: '#ffffff',
  ink: '#2a5db0',
  faint: '#4d7cc4',
  button: '#cfe3ff',
  hot: '#ffffff',
  on: '#3f8cff',
  onInk: '#ffffff',
  good: '#12a35c',
  warn: '#c97400',
  bad: '#e0283a',
};

export function colorsOf(look: Look): Colors {
  return look === 'additive' ? BRIGHT : NORMAL;
}

export class Pen {
  private readonly c: CanvasRenderingContext2D;
  private colors = NORMAL;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.c = canvas.getContext('2d') as CanvasRenderingContext2D;
  }

  begin(colors: Colors): void {
    const { c, canvas } = this;
    this.colors = colors;
    c.clearRect(0, 0, canvas.width, canvas.height);
    c.fillStyle = colors.paper;
    c.strokeStyle = colors.edge;
    c.lineWidth = 3;
    this.round({ x: 2, y: 2, w: canvas.width - 4, h: canvas.height - 4 }, 28);
    c.fill();
    c.stroke();
  }

  clip(x: number, y: number, w: number, h: number): void {
    this.c.save();
    this.c.beginPath();
    this.c.rect(x, y, w, h);
    this.c.clip();
  }

  unclip(): void {
    this.c.restore();
  }

  rule(y: number): void {
    this.c.fillStyle = this.colors.edge;
    this.c.fillRect(24, y, this.canvas.width - 48, 2);
  }

  /** Write text in lines; return the y of the next item. */
  text(text: string, x: number, y: number, w: number, tone: Tone, size: number, most: number, bold = false): number {
    const { c, colors } = this;
    c.font = `${bold ? 600 : 400} ${size}px system-ui, sans-serif`;
    c.fillStyle = tone === 'plain' ? colors.ink : colors[tone];
    c.textAlign = 'left';
    c.textBaseline = 'top';
    const lines = text.split('\n').flatMap((line) => this.wrap(line, w));
    const shown = lines.slice(0, most);
    if (shown.length < lines.length) shown[most - 1] = `${shown[most - 1]} …`;
    shown.forEach((line, i) => c.fillText(line, x, y + i * size * 1.3));
    return y + shown.length * size * 1.3;
  }

  right(text: string, x: number, y: number, size: number): void {
    const { c, colors } = this;
    c.font = `600 ${size}px system-ui, sans-serif`;
    c.fillStyle = colors.ink;
    c.textAlign = 'right';
    c.textBaseline = 'top';
    c.fillText(text, x, y);
    c.textAlign = 'left';
  }

  button(box: Box, label: string, on: boolean, off: boolean, hot: boolean): void {
    const { c, colors } = this;
    c.fillStyle = on ? colors.on : hot && !off ? colors.hot : colors.button;
    c.globalAlpha = off ? 0.45 : 1;
    this.round(box, 14);
    c.fill();
    if (hot && !off) {
      c.strokeStyle = colors.on;
      c.lineWidth = 4;
      c.stroke();
    }
    c.fillStyle = on ? colors.onInk : colors.ink;
    this.middle(label, box);
    c.globalAlpha = 1;
  }

  field(box: Box, text: string): void {
    const { c, colors } = this;
    c.strokeStyle = colors.edge;
    c.lineWidth = 2;
    this.round(box, 14);
    c.stroke();
    c.fillStyle = colors.ink;
    this.middle(text, box);
  }

  bar(box: Box, part: number, off: boolean, hot: boolean): void {
    const { c, colors } = this;
    const y = box.y + box.h / 2;
    const left = box.x + 14;
    const at = left + part * (box.w - 28);
    c.globalAlpha = off ? 0.45 : 1;
    c.fillStyle = colors.button;
    this.round({ x: left, y: y - 6, w: box.w - 28, h: 12 }, 6);
    c.fill();
    c.fillStyle = colors.on;
    this.round({ x: left, y: y - 6, w: Math.max(12, at - left), h: 12 }, 6);
    c.fill();
    c.beginPath();
    c.arc(at, y, hot ? 20 : 16, 0, 2 * Math.PI);
    c.fill();
    c.globalAlpha = 1;
  }

  segments(
    x: number,
    y: number,
    w: number,
    h: number,
    spans: (readonly [string, number, number])[],
    now: number,
  ): void {
    const { c, colors } = this;
    for (const [name, a, b] of spans) {
      const box = { x: x + a * w + 1, y, w: (b - a) * w - 2, h };
      const here = now >= a && now < b;
      c.fillStyle = here ? colors.on : colors.button;
      this.round(box, 6);
      c.fill();
      c.fillStyle = here ? colors.onInk : colors.faint;
      c.font = '400 22px system-ui, sans-serif';
      if (box.w > 40) this.middle(this.fit(name, box.w - 10), box, true);
    }
  }

  private middle(text: string, box: Box, keep = false): void {
    const { c } = this;
    if (!keep) {
      c.font = '500 28px system-ui, sans-serif';
      if (c.measureText(text).width > box.w - 12) c.font = '500 22px system-ui, sans-serif';
    }
    c.textAlign = 'center';
    c.textBaseline = 'middle';
    c.fillText(this.fit(text, box.w - 8), box.x + box.w / 2, box.y + box.h / 2 + 1);
    c.textAlign = 'left';
  }

  private fit(text: string, w: number): string {
    const { c } = this;
    if (c.measureText(text).width <= w) return text;
    let n = text.length;
    while (n > 1 && c.measureText(`${text.slice(0, n)}…`).width > w) n--;
    return `${text.slice(0, n)}…`;
  }

  private wrap(text: string, w: number): string[] {
    const lines: string[] = [];
    let line = '';
    for (const word of text.split(' ')) {
      const longer = line ? `${line} ${word}` : word;
      if (line && this.c.measureText(longer).width > w) {
        lines.push(line);
        line = word;
      } else line = longer;
    }
    return [...lines, line];
  }

  private round(b: Box, r: number): void {
    this.c.beginPath();
    this.c.roundRect(b.x, b.y, Math.max(b.w, 1), b.h, Math.min(r, Math.max(b.w, 1) / 2, b.h / 2));
  }
}
