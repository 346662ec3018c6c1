/** What can be set and read, said once: the desktop page and the panel in the headset both draw this list. */

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
}

export interface Button {
  kind: 'button';
  id: string;
  label: () => string;
  press: () => void;
  on?: () => boolean;
  off?: () => boolean;
  /** Why it cannot be pressed, or what it does. */
  hint?: string;
}

export interface Row {
  kind: 'row';
  items: Button[];
}

export interface Choice {
  kind: 'choice';
  id: string;
  label: string;
  options: () => [value: string, label: string][];
  get: () => string;
  set: (value: string) => void;
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
}

export type Control = Text | Head | Button | Row | Choice | Slider;

export interface Tab {
  id: string;
  label: string;
  controls: Control[];
}

/** All controls; made anew when a robot is loaded. */
export interface Sheet {
  tabs: Tab[];
  /** Always in sight: play, time and speed. */
  transport: Control[];
  status: Text;
}

/** Something that draws the sheet. */
export interface Drawer {
  show(sheet: Sheet): void;
  refresh(): void;
}
