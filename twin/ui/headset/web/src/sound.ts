/** Sound of a contact: a click when the tip touches a hole, a buzz while it does, a higher click for a hole that counts. */

import type { TaskState } from './protocol';

const CLICK = [0.03, 1800] as const; // s and Hz
const DONE = [0.12, 2600] as const;
const BUZZ = 110; // Hz: the buzzer of the phantom
const LOUD = 0.2;

export class ContactSound {
  /** Number of contacts so far. */
  clicks = 0;
  /** Whether the buzz of a contact sounds; not after the end of the task. */
  buzzing = false;
  /** Null before the user's first gesture: browsers allow no sound before it. */
  context: AudioContext | null = null;
  private buzzer: OscillatorNode | null = null;
  private touching = false;
  /** Whether a contact has clicked since the last hole that counts. */
  private heard = false;
  private done = 0;

  constructor() {
    for (const gesture of ['pointerdown', 'keydown'] as const)
      window.addEventListener(gesture, () => this.wake(), { capture: true, passive: true });
  }

  /** Compare the task with the last one, and make the sounds of the difference; called for each picture. */
  hear(task: TaskState | null): void {
    if (task?.contact === undefined) return;
    if (task.contact && !this.touching) {
      this.clicks += 1;
      this.heard = true;
      this.click(...CLICK);
    }
    this.touching = task.contact;
    const contact = task.contact && !task.over;
    const done = task.done ?? 0;
    if (done > this.done) {
      // A contact that began and ended between two pictures counts too.
      this.clicks += done - this.done - (this.heard ? 1 : 0);
      this.heard = false;
      this.click(...DONE);
    }
    this.done = done;
    if (contact !== this.buzzing) this.buzz(contact);
    this.buzzing = contact;
  }

  private wake(): void {
    this.context ??= new AudioContext();
    if (this.context.state === 'suspended') void this.context.resume();
  }

  private click(seconds: number, frequency: number): void {
    if (!this.context) return;
    const [tone, volume] = this.tone(frequency, 'sine', LOUD);
    const { currentTime } = this.context;
    volume.gain.exponentialRampToValueAtTime(1e-3, currentTime + seconds);
    tone.start();
    tone.stop(currentTime + seconds);
  }

  private buzz(on: boolean): void {
    this.buzzer?.stop();
    this.buzzer = null;
    if (!on || !this.context) return;
    [this.buzzer] = this.tone(BUZZ, 'square', LOUD / 4);
    this.buzzer.start();
  }

  private tone(frequency: number, type: OscillatorType, loud: number): [OscillatorNode, GainNode] {
    const context = this.context as AudioContext;
    const [tone, volume] = [new OscillatorNode(context, { frequency, type }), new GainNode(context, { gain: loud })];
    tone.connect(volume).connect(context.destination);
    return [tone, volume];
  }
}
