/** Data of all controls and displays, which the desktop page and the panel in the headset both draw. */

export type Tone = 'plain' | 'good' | 'warn' | 'bad' | 'faint';

export interface Text {
  kind: 'text';
  id: string;
  text: () => string;
  tone?: () => Tone;
}

export interface Head {
  kind: 'head';
  text: string;
  /** Whether the heading is visible; always without it. */
  shown?: () => boolean;
}

export interface Button {
  kind: 'button';
  id: string;
  label: () => string;
  press: () => void;
  on?: () => boolean;
  off?: () => boolean;
  /** What the button does, or why it is disabled. */
  hint: string;
}

export interface Row {
  kind: 'row';
  items: Button[];
  /** Whether the row is visible; always without it. */
  shown?: () => boolean;
}

export interface Choice {
  kind: 'choice';
  id: string;
  label: string;
  options: () => [value: string, label: string][];
  get: () => string;
  set: (value: string) => void;
  /** What the choice changes. */
  hint: string;
}

export interface Slider {
  kind: 'slider';
  id: string;
  label: string;
  range: () => [number, number];
  get: () => number;
  set: (value: number) => void;
  show: (value: number) => string;
  begin?: () => void;
  end?: () => void;
  segments?: () => readonly (readonly [name: string, start: number, end: number])[];
  off?: () => boolean;
  /** What the slider changes. */
  hint: string;
}

export type Control = Text | Head | Button | Row | Choice | Slider;

export interface Tab {
  id: string;
  label: string;
  controls: Control[];
  /** What the controls are for. */
  hint: string;
}

/** All controls; created again when a robot is loaded. */
export interface Sheet {
  tabs: Tab[];
  /** Whether the tabs are folded at first on a page that is at most 1400 pixels wide, as beside the board of a procedure. */
  folds?: boolean;
  /** Controls that are always visible: play, time and speed. */
  transport: Control[];
  status: Text;
  /** Whether the server does not answer, so that no control can do anything. */
  lost: () => boolean;
}

/** Interface of a view that draws the sheet. */
export interface Drawer {
  show(sheet: Sheet): void;
  refresh(): void;
}
