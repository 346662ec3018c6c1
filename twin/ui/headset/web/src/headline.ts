/** Values in words and colour: the machine, the RCM, the insertion depth, the nearest joint limit. */

import type { App } from './app';
import { isAngle, jointValue, length } from './model';
import type { Tone } from './controls';

/** Maximum accepted distance in m of the shaft from the RCM. */
const RCM = 1e-4;
/** Shares of a joint's range next to a limit that are red and amber. */
const [TIGHT, NEAR] = [0.02, 0.1];

/** What the run levels of a machine mean. */
const LEVELS: Readonly<Record<string, string>> = {
  E_STOP: 'is stopped (E_STOP)',
  INIT: 'moves to its start (INIT)',
  PEDAL_UP: 'is at rest (PEDAL_UP)',
  PEDAL_DN: 'follows the hand (PEDAL_DN)',
};

export class Headline {
  readonly box = document.createElement('ul');
  private readonly items: HTMLLIElement[] = [];

  constructor(private readonly app: App) {
    this.box.className = 'headline';
    for (let i = 0; i < 4; i++) {
      const item = document.createElement('li');
      this.items.push(item);
      this.box.append(item);
    }
  }

  refresh(): void {
    const values = [this.machine(), this.rcm(), this.depth(), this.limit()];
    this.box.hidden = this.app.console !== null;
    values.forEach((value, i) => {
      const item = this.items[i] as HTMLLIElement;
      item.hidden = value === null;
      if (!value) return;
      item.dataset['tone'] = value[0];
      if (item.textContent !== value[1]) item.textContent = value[1];
    });
  }

  private machine(): [Tone, string] | null {
    const { machine } = this.app.model.state;
    if (!machine) return null;
    const level = machine.level === null ? 'does not answer' : (LEVELS[machine.level] ?? machine.level);
    const behind = machine.behind === null ? '' : `, ${length(machine.behind)} behind`;
    const said = `Machine ${level}${behind}`;
    return machine.problem ? ['bad', `${said}: ${machine.problem}`] : ['good', said];
  }

  private rcm(): [Tone, string] | null {
    const error = this.app.model.state.rcm_error_m;
    if (error === null || error === undefined) return null;
    return error <= RCM ? ['good', 'Shaft passes through the port (RCM)'] : ['warn', `Shaft misses the port (RCM) by ${length(error)}`];
  }

  private depth(): [Tone, string] | null {
    const depth = this.app.model.state.depth_m;
    if (depth === null || depth === undefined) return null;
    return depth > 0 ? ['good', `Inserted ${length(depth)}`] : ['plain', `Not inserted, ${length(-depth)} outside`];
  }

  private limit(): [Tone, string] | null {
    const { info } = this.app.model;
    let least = Infinity;
    let text = '';
    for (const joint of info?.joints.filter((j) => j.active) ?? []) {
      const { lower, upper } = joint;
      if (lower === null || upper === null || lower === undefined || upper === undefined || !(upper > lower)) continue;
      const value = this.app.model.joint(joint.name);
      const room = Math.min(value - lower, upper - value);
      if (room / (upper - lower) >= least) continue;
      least = room / (upper - lower);
      text = `Nearest limit: ${joint.name}, ${jointValue(Math.max(room, 0), isAngle(joint))} away`;
    }
    if (!text) return null;
    return [least < TIGHT ? 'bad' : least < NEAR ? 'warn' : 'good', text];
  }
}
