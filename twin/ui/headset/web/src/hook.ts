/** `window.twin`: state of the page for tests and debugging; no part of the page uses it. */

import type { Object3D } from 'three';
import type { App } from './app';
import type { Member } from './member';
import type { SelfTest } from './selftest';

export interface Hook {
  app: App;
  /** The self-test; only with `?selftest`. */
  test?: SelfTest;
  /** World matrix (16 numbers, by columns) of each link's node; with several robots, keys are "<robot>/<link>". */
  links: () => Record<string, number[]>;
  /** Matrix of the world node (z up) in the scene (y up). */
  root: () => number[];
  /** Drawn vertices of deformables in the world frame. */
  field: (name: string) => number[];
  /** Poses of the newest frame by link, with the same keys, in the base frame of the robot. */
  poses: () => Record<string, number[]>;
  /** View and projection matrix of the camera of the last picture (left eye in XR). */
  camera: () => { view: number[]; projection: number[]; width: number; height: number };
  /** Paint each link in a different flat colour, hide all other objects, and return the colours. */
  paint: (on: boolean) => Record<string, string>;
}

declare global {
  interface Window {
    twin: Hook;
  }
}

export function hook(app: App): void {
  const { world } = app;
  const hidden: { visible: boolean }[] = [];
  const named = (member: Member, link: string) =>
    app.members.length > 1 ? `${member.model.info?.name}/${link}` : link;
  window.twin = {
    app,
    links: () => {
      world.scene.updateMatrixWorld(true);
      return Object.fromEntries(
        app.members.flatMap((m) =>
          [...(m.robot?.links ?? [])].map(([n, l]) => [named(m, n), l.node.matrixWorld.toArray()]),
        ),
      ) as Record<string, number[]>;
    },
    root: () => world.robotWorld.matrixWorld.toArray(),
    poses: () => {
      return Object.fromEntries(
        app.members.flatMap((m) => {
          const { info, frame } = m.model;
          if (!info || !frame) return [];
          return info.links.map((n, i) => [named(m, n), [...frame.poses.subarray(7 * i, 7 * i + 7)]]);
        }),
      ) as Record<string, number[]>;
    },
    field: (name) => app.fields.vertices(name),
    camera: () => {
      const xr = world.renderer.xr;
      const eye = xr.isPresenting ? (xr.getCamera().cameras[0] ?? world.camera) : world.camera;
      const { width, height } = world.renderer.domElement;
      return { view: eye.matrixWorldInverse.toArray(), projection: eye.projectionMatrix.toArray(), width, height };
    },
    paint: (on) => {
      app.drawn.show(!on, true);
      let first = 0;
      for (const { robot } of app.members) {
        robot?.paint(on, first);
        first += robot?.links.size ?? 0;
      }
      if (on) {
        const places = app.members.map((m) => m.place as Object3D);
        const others = world.scene.children.filter((o) => o !== world.placement);
        others.push(...world.robotWorld.children.filter((o) => !places.includes(o)));
        for (const m of app.members) others.push(...m.place.children.filter((o) => o !== m.robot?.root));
        for (const thing of others.flatMap((o) => [o, ...o.children]))
          // XR devices make their rays visible again
          if (thing.visible) {
            thing.visible = false;
            hidden.push(thing);
          }
      } else for (const thing of hidden.splice(0)) thing.visible = true;
      world.touch();
      const colors = app.members.flatMap((m) =>
        [...(m.robot?.links ?? [])].map(([name, link]) => {
          const material = link.skins[0]?.mesh.material as { color?: { getHexString: () => string } } | undefined;
          return [named(m, name), material?.color?.getHexString() ?? ''];
        }),
      );
      return Object.fromEntries(colors) as Record<string, string>;
    },
  };
}
