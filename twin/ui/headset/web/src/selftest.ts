/**
 * `?selftest`: tests of this device with known numbers and markers, started by one press. The page checks the numbers;
 * the user checks the markers. A missing feature is reported as "not here", not as a failure.
 */

import { ArrowHelper, BoxGeometry, CylinderGeometry, Group, Mesh, Vector3 } from 'three';
import type { App } from './app';
import type { Sheet, Tone } from './controls';
import { parseFrame } from './frame';
import { Label } from './label';
import { flat } from './ink';
import { checkPicture } from './selftest_picture';
import type { Robot } from './robot';

interface Result {
  name: string;
  verdict: 'pass' | 'FAIL' | 'not here';
  said: string;
}

/** A frame as packed by the server: 2 links, 1 joint, with a ghost. */
const FRAME =
  'VFdOMQcAAAAAAAAAAAApQAAAAAAAAApAAgABAAUAAAAAAIA/AAAAQAAAQEAAAAAAAAAAAAAAAAAAAIA/AACAPgAAAL8AAAA+AAAAPwAAAD8AAAA/AAAAPwAAQD8AAIA/AAAAAAAAAAAAAAAAmpkZPwAAAADNzEw/';

/** Matrix of its second link in the scene (y up), by columns. */
const IN_SCENE = [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0.25, 0.125, 0.5, 1];

const WATCHED = 120; // number of pictures for the measurement of the picture rate

export class SelfTest {
  readonly results: Result[] = [];
  done = false;
  private readonly list = document.createElement('ol');
  private readonly verdict = document.createElement('p');
  private readonly markers = new Group();

  constructor(
    private readonly app: App,
    page: HTMLElement,
  ) {
    const box = document.createElement('section');
    box.className = 'selftest';
    const title = document.createElement('h1');
    title.textContent = 'Self-test';
    const about = document.createElement('p');
    about.textContent =
      'Press once. With a headset, the page enters XR, shows markers on the floor and measures for some seconds. Without a headset, it runs the other tests. The authors have not yet run this page on a headset.';
    const button = document.createElement('button');
    button.className = 'enter';
    button.dataset['id'] = 'selftest';
    button.textContent = 'Run the self-test';
    button.onclick = () => void this.run();
    this.list.dataset['id'] = 'results';
    this.verdict.dataset['id'] = 'verdict';
    box.append(title, about, button, this.verdict, this.list);
    page.append(box);
    this.markers.visible = false;
    app.world.scene.add(this.markers);
    this.stand();
  }

  async run(): Promise<void> {
    this.results.length = 0;
    this.done = false;
    this.markers.visible = true;
    const { app } = this;
    // A session can be entered only directly after a press, so this comes first.
    const entered = app.xr.ar || app.xr.vr ? app.xr.enter() : null;
    this.numbers();
    this.results.push(...checkPicture(app.world.renderer.capabilities.isWebGL2));
    await this.stream();
    await entered;
    if (app.xr.session) await this.session(app.xr.session);
    else this.add('headset', 'not here', app.xr.text);
    this.done = true;
    this.show();
  }

  // -- numbers -------------------------------------------------------------------------------------------

  private numbers(): void {
    this.attempt('a frame of the stream is decoded', () => {
      const bytes = Uint8Array.from(atob(FRAME), (c) => c.charCodeAt(0));
      const frame = parseFrame(bytes.buffer);
      const is = [
        frame.seq,
        frame.serverTime,
        frame.clipTime,
        frame.flags,
        frame.q[0],
        frame.poses[8],
        frame.ghost?.[6],
      ];
      return worst(is.map(Number), [7, 12.5, 3.25, 5, 0.75, -0.5, Math.fround(0.8)]);
    });
    this.attempt('z up is converted to y up exactly once', () => {
      const bytes = Uint8Array.from(atob(FRAME), (c) => c.charCodeAt(0));
      const world = new Group();
      world.rotation.x = -Math.PI / 2;
      const node = new Group();
      world.add(node);
      node.position.fromArray(parseFrame(bytes.buffer).poses, 7);
      node.quaternion.fromArray(parseFrame(bytes.buffer).poses, 10);
      world.updateMatrixWorld(true);
      return worst(node.matrixWorld.toArray(), IN_SCENE);
    });
  }

  private async stream(): Promise<void> {
    const { line, model } = this.app;
    const before = line.frames;
    const start = performance.now();
    await pause(2000);
    const rate = (1000 * (line.frames - before)) / (performance.now() - start);
    const trip = Number.isFinite(line.roundTrip) ? `${line.roundTrip.toFixed(0)} ms round trip` : 'no answer yet';
    const open = line.line === 'open' && model.frame !== null;
    this.add('stream', open ? 'pass' : 'FAIL', open ? `${rate.toFixed(0)} frames/s, ${trip}` : model.status().text);
    const robot = this.app.robot;
    if (robot && model.frame && model.info) this.links(robot);
    else this.add('links stand where the stream says', 'FAIL', 'no robot');
  }

  private links(robot: Robot): void {
    this.attempt('links stand where the stream says', () => {
      const { member, model, world } = this.app;
      world.scene.updateMatrixWorld(true);
      const poses = model.frame?.poses ?? new Float32Array();
      return Math.max(
        ...(model.info?.links ?? []).map((name, i) => {
          const node = robot.links.get(name)?.node;
          if (!node) return Infinity;
          const p = member.place.worldToLocal(node.getWorldPosition(new Vector3()));
          return p.distanceTo(new Vector3().fromArray(poses, 7 * i));
        }),
      );
    });
  }

  // -- the headset ---------------------------------------------------------------------------------------

  private async session(session: XRSession): Promise<void> {
    const { xr } = this.app;
    const first = xr.frames;
    const start = performance.now();
    while (xr.session && xr.frames - first < WATCHED && performance.now() - start < 20000) await pause(100);
    const rate = (1000 * (xr.frames - first)) / (performance.now() - start);
    this.add('session', 'pass', `${xr.mode}, the display is ${xr.blend}`);
    this.add('pictures', rate >= 30 ? 'pass' : 'FAIL', `${rate.toFixed(0)}/s, required: at least 30`);
    const eyes = this.app.world.renderer.xr.getCamera().cameras;
    const [left, right] = eyes.map((c) => new Vector3().setFromMatrixPosition(c.matrixWorld));
    if (left && right) {
      const apart = 1000 * left.distanceTo(right);
      this.add('eyes', apart > 45 && apart < 85 ? 'pass' : 'FAIL', `${apart.toFixed(1)} mm apart, required: 45 to 85`);
    } else this.add('eyes', 'not here', 'one view');
    const head = xr.viewer().y;
    this.add('floor', head > 0.4 && head < 2.4 ? 'pass' : 'FAIL', `the head is ${head.toFixed(2)} m above the floor`);
    this.add('hit test', xr.canPlace ? 'pass' : 'not here', xr.canPlace ? 'available' : 'not available');
    const sources = [...session.inputSources].map((s) => (s.hand ? 'hand' : s.targetRayMode));
    this.add('input', sources.length ? 'pass' : 'not here', sources.join(', ') || 'none: use gaze');
  }

  /** Markers for the user: a cube of 10 cm, a rod of 1 m, three axes. */
  private stand(): void {
    const cube = new Mesh(new BoxGeometry(0.1, 0.1, 0.1), flat(0xf0b429));
    cube.position.set(0, 0.05, -1);
    this.markers.add(cube);
    for (let i = 0; i < 10; i++) {
      const piece = new Mesh(new CylinderGeometry(0.01, 0.01, 0.1, 16), flat(i % 2 ? 0xffffff : 0x2268c9));
      piece.position.set(0.3, 0.05 + 0.1 * i, -1);
      this.markers.add(piece);
    }
    const axes: [Vector3, number][] = [
      [new Vector3(1, 0, 0), 0xd81b2a],
      [new Vector3(0, 0, -1), 0x18a35d],
      [new Vector3(0, 1, 0), 0x2268c9],
    ];
    for (const [way, color] of axes)
      this.markers.add(new ArrowHelper(way, new Vector3(-0.35, 0.01, -1), 0.3, color, 0.06, 0.04));
    const label = new Label();
    label.say(
      'cube: 10 cm, 1 m ahead, on the floor\nrod: 1 m high, pieces of 10 cm\nred: right (x)  green: ahead (y)  blue: up (z)',
      '#12438a',
      'normal',
      0.035,
    );
    label.sprite.position.set(-0.3, 1.05, -1);
    label.sprite.visible = true;
    this.markers.add(label.sprite);
  }

  // -- results -------------------------------------------------------------------------------------------

  private attempt(name: string, error: () => number): void {
    try {
      const is = error();
      this.add(name, is <= 1e-6 ? 'pass' : 'FAIL', `worst error ${is.toExponential(1)}`);
    } catch (problem) {
      this.add(name, 'FAIL', (problem as Error).message);
    }
  }

  private add(name: string, verdict: Result['verdict'], said: string): void {
    this.results.push({ name, verdict, said });
    this.show();
  }

  private show(): void {
    const failed = this.results.filter((r) => r.verdict === 'FAIL').length;
    const absent = this.results.filter((r) => r.verdict === 'not here').length;
    const passed = this.results.length - failed - absent;
    this.verdict.textContent = this.done
      ? `${passed} passed, ${failed} failed, ${absent} not here. ${navigator.userAgent}`
      : 'Running …';
    this.verdict.dataset['tone'] = failed ? 'bad' : 'good';
    this.list.replaceChildren(
      ...this.results.map((r) => {
        const item = document.createElement('li');
        item.textContent = `${r.verdict}: ${r.name} (${r.said})`;
        item.dataset['verdict'] = r.verdict;
        return item;
      }),
    );
    this.app.xrPanel.show(this.sheet());
  }

  private sheet(): Sheet {
    const tone = (r: Result): Tone => (r.verdict === 'pass' ? 'good' : r.verdict === 'FAIL' ? 'bad' : 'faint');
    return {
      tabs: [
        {
          id: 'simulation', // the tab that is open first
          label: 'Self-test',
          hint: 'Results of the checks so far',
          controls: this.results.map((r, i) => ({
            kind: 'text',
            id: `result-${i}`,
            text: () => `${r.verdict}: ${r.name} (${r.said})`,
            tone: () => tone(r),
          })),
        },
      ],
      transport: [
        {
          kind: 'row',
          items: [
            { kind: 'button', id: 'leave', label: () => 'Leave the headset', hint: 'End the self-test', press: () => void this.app.xr.leave() },
          ],
        },
      ],
      status: { kind: 'text', id: 'status', text: () => this.verdict.textContent ?? '', tone: () => 'plain' },
      lost: () => false,
    };
  }
}

function worst(is: number[], wanted: number[]): number {
  return Math.max(...wanted.map((w, i) => Math.abs(w - (is[i] ?? NaN))).map((e) => (Number.isNaN(e) ? Infinity : e)));
}

const pause = (ms: number): Promise<void> => new Promise((resolve) => setTimeout(resolve, ms));
