/** Text in the scene, on a small card that always faces the viewer. */

import { CanvasTexture, Sprite, SpriteMaterial, SRGBColorSpace } from 'three';
import type { Look } from './world';

const FONT = 44;

export class Label {
  readonly sprite: Sprite;
  private readonly canvas = document.createElement('canvas');
  private readonly texture = new CanvasTexture(this.canvas);
  private shown = '';
  private height = 0.03;

  constructor() {
    this.texture.colorSpace = SRGBColorSpace;
    this.sprite = new Sprite(
      new SpriteMaterial({ map: this.texture, depthTest: false, transparent: true, toneMapped: false }),
    );
    this.sprite.center.set(0, 0);
    this.sprite.renderOrder = 9;
    this.sprite.visible = false;
  }

  /** Show lines of text in a colour; `height` is the height of one line in m. */
  say(text: string, color: string, look: Look, height: number): void {
    const key = `${text}|${color}|${look}|${height}`;
    if (key === this.shown) return;
    this.shown = key;
    this.height = height;
    const lines = text.split('\n');
    const pen = this.canvas.getContext('2d') as CanvasRenderingContext2D;
    const font = `600 ${FONT}px system-ui, sans-serif`;
    pen.font = font;
    const width = Math.ceil(Math.max(...lines.map((l) => pen.measureText(l).width)) + FONT);
    const tall = Math.ceil(lines.length * FONT * 1.3 + FONT * 0.5);
    if (this.canvas.width !== width || this.canvas.height !== tall) {
      this.canvas.width = width;
      this.canvas.height = tall;
      this.texture.dispose(); // the size of a texture cannot change
    }
    pen.font = font;
    pen.clearRect(0, 0, width, tall);
    pen.fillStyle = look === 'additive' ? '#e8f1ff' : '#ffffffee';
    pen.beginPath();
    pen.roundRect(2, 2, width - 4, tall - 4, FONT * 0.3);
    pen.fill();
    pen.lineWidth = 3;
    pen.strokeStyle = color;
    pen.stroke();
    pen.fillStyle = color;
    pen.textBaseline = 'middle';
    lines.forEach((l, i) => pen.fillText(l, FONT / 2, FONT * (0.9 + 1.3 * i)));
    this.texture.needsUpdate = true;
    const scale = this.height / (FONT * 1.3);
    this.sprite.scale.set(width * scale, tall * scale, 1);
  }
}
