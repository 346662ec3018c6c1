/** Stereo in both halves of the window: the controls are in the left half, and a copy of them in the right half. */

const AGAIN = 250; // ms between two copies

export class Halves {
  private readonly copy = document.createElement('div');
  private copied = -Infinity;

  /** `page` contains the controls. */
  constructor(private readonly page: HTMLElement) {
    this.copy.className = 'copy';
    this.copy.dataset['id'] = 'copy';
    this.copy.setAttribute('aria-hidden', 'true');
    this.copy.inert = true;
  }

  /** Compress the controls into the left half and show their copy, or show them as usual. */
  show(on: boolean): void {
    document.documentElement.toggleAttribute('data-halves', on);
    if (on) this.page.after(this.copy);
    else this.copy.remove();
    this.copied = -Infinity;
  }

  /** Copy the controls again, if it is time; called with each picture. */
  refresh(): void {
    const now = performance.now();
    if (!this.copy.isConnected || now - this.copied < AGAIN) return;
    this.copied = now;
    const copies = [...this.page.children].map((node) => node.cloneNode(true) as HTMLElement);
    this.copy.replaceChildren(...copies);
    const from = this.page.querySelectorAll('*');
    const to = this.copy.querySelectorAll<HTMLElement>('*');
    // What is not in the text of the page: pictures, chosen options, places of sliders and of scrolled lists.
    from.forEach((node, i) => {
      const twin = to[i];
      if (!twin) return;
      if (node instanceof HTMLCanvasElement) (twin as HTMLCanvasElement).getContext('2d')?.drawImage(node, 0, 0);
      if (node instanceof HTMLSelectElement || node instanceof HTMLInputElement) (twin as HTMLInputElement).value = node.value;
      if (node.scrollTop) twin.scrollTop = node.scrollTop;
    });
  }
}
