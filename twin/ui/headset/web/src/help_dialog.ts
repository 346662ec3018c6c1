/** The list of what mouse, fingers and keys do, behind the button `?`. */

/** A part of the list; its texts are read when the list is opened. */
export interface HelpPart {
  head: string;
  rows: () => readonly (readonly [what: string, how: string])[];
}

export class HelpDialog {
  private readonly list = document.createElement('dialog');
  private readonly body = document.createElement('div');

  constructor(
    parent: HTMLElement,
    private readonly parts: () => readonly HelpPart[],
  ) {
    this.list.className = 'keys';
    this.list.setAttribute('aria-label', 'Mouse and keys');
    const close = document.createElement('button');
    close.className = 'push';
    close.textContent = 'Close';
    close.title = 'Hide this list (Escape)';
    close.onclick = () => this.list.close();
    this.body.tabIndex = 0; // so that keys can scroll a long list
    this.body.className = 'keys-body';
    this.list.append(this.body, close);
    parent.append(this.list);
  }

  get open(): boolean {
    return this.list.open;
  }

  /** Show or hide the list. */
  toggle(): void {
    if (this.list.open) {
      this.list.close();
      return;
    }
    this.body.replaceChildren(...this.parts().flatMap((part) => drawn(part)));
    this.list.showModal();
    this.body.scrollTop = 0;
  }
}

function drawn(part: HelpPart): HTMLElement[] {
  const rows = part.rows();
  if (!rows.length) return [];
  const table = document.createElement('table');
  for (const [what, how] of rows) {
    const row = table.insertRow();
    const name = document.createElement('th');
    name.scope = 'row';
    name.textContent = what;
    row.append(name);
    row.insertCell().textContent = how;
  }
  if (!part.head) return [table];
  const head = document.createElement('h2');
  head.textContent = part.head;
  return [head, table];
}
