/** `window.twin`: what tests and the curious may look at. Nothing of the page depends on it. */

import type { App } from './app';
import type { SelfTest } from './selftest';

export interface Hook {
  app: App;
  /** With `?selftest`. */
  test?: SelfTest;
  /** World matrix (16 numbers, column after column) of each link's node. */
  links: () => Record<string, number[]>;
  /** Matrix of the world of the robot (z up) in the scene. */
  root: () => number[];
  /** Poses of the newest frame by link. */
  poses: () => Record<string, number[]>;
  /** View and projection of the camera that drew last (the left eye in XR). */
  camera: () => { view: number[]; projection: number[]; width: number; height: number };
  /** Paint every link in a flat colour of its own, and hide all else; answers with the colours. */
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
  window.twin = {
    app,
    links: () => {
      world.scene.updateMatrixWorld(true);
      return Object.fromEntries([...(app.robot?.links ?? [])].map(([n, l]) => [n, l.node.matrixWorld.toArray()]));
    },
    root: () => world.robotWorld.matrixWorld.toArray(),
    poses: () => {
      const { info, frame } = app.model;
      if (!info || !frame) return {};
      return Object.fromEntries(info.links.map((n, i) => [n, [...frame.poses.subarray(7 * i, 7 * i + 7)]]));
    },
    camera: () => {
      const xr = world.renderer.xr;
      const eye = xr.isPresenting ? (xr.getCamera().cameras[0] ?? world.camera) : world.camera;
      const { width, height } = world.renderer.domElement;
      return { view: eye.matrixWorldInverse.toArray(), projection: eye.projectionMatrix.toArray(), width, height };
    },
    paint: (on) => {
      app.robot?.paint(on);
      if (on) {
        const others = world.scene.children.filter((o) => o !== world.placement);
        others.push(...world.robotWorld.children.filter((o) => o !== app.robot?.root));
        for (const thing of others.flatMap((o) => [o, ...o.children]))
          // a device sets its rays visible itself
          if (thing.visible) {
            thing.visible = false;
            hidden.push(thing);
          }
      } else for (const thing of hidden.splice(0)) thing.visible = true;
      world.touch();
      const colors = Object.entries(app.robot ? Object.fromEntries(app.robot.links) : {}).map(([name, link]) => {
        const material = link.skins[0]?.mesh.material as { color?: { getHexString: () => string } } | undefined;
        return [name, material?.color?.getHexString() ?? ''];
      });
      return Object.fromEntries(colors) as Record<string, string>;
    },
  };
}
