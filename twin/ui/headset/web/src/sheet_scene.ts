/** The controls for displays and place, and the data of the robot. */

import type { App } from './app';
import type { Button, Control, Tab } from './controls';
import { isAngle, jointValue } from './model';
import type { Shows } from './overlays';

export function scene(app: App): Tab {
  const m = app.model;
  const show = (key: keyof Shows, label: string): Button => ({
    kind: 'button',
    id: `show-${key}`,
    label: () => label,
    on: () => app.overlays.shows[key],
    press: () => app.show(key),
  });
  const toggle = (id: string, label: string, on: () => boolean, flip: () => void): Button => ({
    kind: 'button',
    id,
    label: () => label,
    on,
    press: () => {
      flip();
      app.showAround();
    },
  });
  const rows: Button[][] = [[show('path', 'Tool path'), show('rcm', 'RCM and shaft')], []];
  if (m.info?.has_workspace) rows[1]?.push(show('workspace', 'Workspace'));
  if (m.info?.scenery) rows[1]?.push(show('scenery', 'Table and patient'));
  const around = m.scene?.props;
  const marks = m.scene?.cameras.length || m.robots.some((r) => r.info?.ports.length);
  if (around)
    rows.push([
      toggle('surroundings', 'Surroundings', () => !app.hidden, () => (app.hidden = !app.hidden)),
      toggle('through', 'Transparent', () => app.surroundings.seeThrough, () => {
        app.surroundings.seeThrough = !app.surroundings.seeThrough;
      }),
    ]);
  if (marks)
    rows.push([
      toggle('marks', 'Ports and cameras', () => app.surroundings.marks, () => {
        app.surroundings.marks = !app.surroundings.marks;
      }),
    ]);
  rows.push([
    show('labels', 'Labels'),
    {
      kind: 'button',
      id: 'look',
      label: () => 'Bright, for additive displays',
      on: () => app.world.look === 'additive',
      press: () => app.setLook(app.world.look === 'additive' ? 'normal' : 'additive'),
    },
  ]);
  const controls: Control[] = [
    { kind: 'head', text: 'Show' },
    ...rows.filter((r) => r.length).map((items): Control => ({ kind: 'row', items })),
  ];
  controls.push({ kind: 'text', id: 'patient', tone: () => 'faint', text: () => app.overlays.sceneryText(m.robot) });
  controls.push({ kind: 'text', id: 'cloud', tone: () => 'faint', text: () => app.cloudText() });
  if (m.info?.variants.length)
    controls.push(
      {
        kind: 'choice',
        id: 'variant',
        label: 'Ghost of the equations: variant',
        options: () => [['', 'not shown'], ...(m.info?.variants ?? []).map((v): [string, string] => [v, v])],
        get: () => m.state.variant ?? '',
        set: (v) => app.ask('variant', { name: v || null }),
      },
      { kind: 'text', id: 'ghost', tone: () => 'faint', text: () => app.overlays.ghostText },
    );
  controls.push(
    { kind: 'head', text: 'Size and place' },
    {
      kind: 'slider',
      id: 'scale',
      label: 'Size',
      range: () => [-1, 1],
      get: () => Math.log10(app.place.scale),
      set: (v) => app.place.setScale(10 ** v),
      show: (v) => `${(10 ** v).toFixed(2)}×`,
    },
    {
      kind: 'slider',
      id: 'yaw',
      label: 'Turn',
      range: () => [-Math.PI, Math.PI],
      get: () => app.place.yaw,
      set: (v) => app.place.setYaw(v),
      show: (v) => `${((180 / Math.PI) * v).toFixed(0)}°`,
    },
    {
      kind: 'slider',
      id: 'height',
      label: 'Height',
      range: () => [-0.5, 1.5],
      get: () => app.place.height,
      set: (v) => app.place.setHeight(v),
      show: (v) => `${(100 * v).toFixed(0)} cm`,
    },
    {
      kind: 'row',
      items: [
        {
          kind: 'button',
          id: 'place',
          label: () => 'Place on the floor',
          on: () => app.place.placing,
          off: () => !app.xr.canPlace,
          press: () => app.place.begin(),
          hint: 'Only in AR',
        },
        {
          kind: 'button',
          id: 'move',
          label: () => 'Move by hand',
          on: () => app.place.moving,
          off: () => !app.xr.presenting,
          press: () => {
            app.place.moving = !app.place.moving;
            app.refresh();
          },
          hint: 'In XR: pinch to move the whole robot; pinch with both hands to turn and scale it',
        },
        { kind: 'button', id: 'reset', label: () => 'Reset', press: () => app.place.reset() },
      ],
    },
  );
  return { id: 'scene', label: 'Scene', controls };
}

export function robot(app: App): Tab {
  const m = app.model;
  const assumed = [...(m.info?.assumed ?? []), ...(m.scene?.assumed ?? [])];
  const count = assumed.length;
  return {
    id: 'robot',
    label: 'Robot',
    controls: [
      { kind: 'text', id: 'name', text: () => m.info?.title || m.info?.name || '' },
      {
        kind: 'text',
        id: 'about',
        tone: () => 'faint',
        text: () =>
          `${m.info?.links.length ?? 0} links, ${m.info?.joints.length ?? 0} joints, ${m.info?.joints.filter((j) => j.active).length ?? 0} of them active\nmodel ${m.info?.model_hash.slice(0, 19) ?? ''}`,
      },
      {
        kind: 'text',
        id: 'values',
        text: () =>
          (m.info?.joints ?? [])
            .filter((j) => j.active)
            .map((j) => `${j.name}  ${jointValue(m.joint(j.name), isAngle(j))}`)
            .join('\n'),
      },
      { kind: 'text', id: 'line', tone: () => 'faint', text: () => app.lineText() },
      { kind: 'head', text: count === 1 ? '1 ASSUMED parameter' : `${count} ASSUMED parameters` },
      {
        kind: 'text',
        id: 'assumed',
        tone: () => 'faint',
        text: () => (count ? assumptions(assumed) : 'None: every number has a source.'),
      },
    ],
  };
}

/** Return the assumed parameters as text, grouped by reason. */
function assumptions(all: readonly string[]): string {
  const reasons = new Map<string, string[]>();
  for (const line of all) {
    const [name = '', ...rest] = line.split(': ');
    const why = rest.join(': ');
    reasons.set(why, [...(reasons.get(why) ?? []), name]);
  }
  return [...reasons].map(([why, names]) => `• ${names.join(', ')}: ${why}`).join('\n');
}
