/** The controls for displays and place, and the data of the robot. */

import type { App } from './app';
import type { Button, Control, Tab } from './controls';
import { isAngle, jointValue } from './model';
import type { Shows } from './overlays';

/** What each display shows. */
const SHOWN: Readonly<Record<keyof Shows, string>> = {
  path: 'The path of the tool along the protocol',
  rcm: 'The point through which the shaft passes (RCM), and the shaft',
  workspace: 'The positions that the tool can reach in its present direction',
  ghost: 'Where the equations expect the tool',
  scenery: 'The table and the patient of the protocol',
  labels: 'Texts in the picture',
};

export function scene(app: App): Tab {
  const m = app.model;
  const show = (key: keyof Shows, label: string): Button => ({
    kind: 'button',
    id: `show-${key}`,
    label: () => label,
    on: () => app.overlays.shows[key],
    hint: SHOWN[key],
    press: () => app.show(key),
  });
  const toggle = (id: string, label: string, hint: string, on: () => boolean, flip: () => void): Button => ({
    kind: 'button',
    id,
    label: () => label,
    hint,
    on,
    press: () => {
      flip();
      app.showAround();
    },
  });
  const rows: Button[][] = [[show('path', 'Tool path'), show('rcm', 'RCM and shaft')], []];
  if (m.info?.has_workspace) rows[1]?.push(show('workspace', 'Workspace'));
  if (m.info?.scenery) rows[1]?.push(show('scenery', 'Table and patient'));
  const drawn: Button[] = [];
  if (m.scene?.person)
    drawn.push({
      kind: 'button',
      id: 'person',
      label: () => 'Person, for scale',
      hint: 'Show an adult of 1.75 m beside the robot',
      on: () => app.drawn.personal,
      press: () => void app.stand(!app.drawn.personal),
    });
  if (m.scene?.drawn)
    drawn.push(
      toggle('drawn', 'Drawn parts', 'Show what is drawn and not measured, such as belts, cables and drapes', () => app.drawn.on, () => {
        app.drawn.on = !app.drawn.on;
      }),
    );
  rows.push(drawn);
  const around = m.scene?.props;
  const marks = m.scene?.cameras.length || m.robots.some((r) => r.info?.ports.length);
  if (around)
    rows.push([
      toggle('surroundings', 'Surroundings', 'Show or hide table, patient and walls', () => !app.hidden, () => (app.hidden = !app.hidden)),
      toggle('through', 'Transparent', 'See through the surroundings', () => app.surroundings.seeThrough, () => {
        app.surroundings.seeThrough = !app.surroundings.seeThrough;
      }),
    ]);
  if (marks)
    rows.push([
      toggle('marks', 'Ports and cameras', 'Mark the ports in the patient and the cameras', () => app.surroundings.marks, () => {
        app.surroundings.marks = !app.surroundings.marks;
      }),
    ]);
  rows.push([
    show('labels', 'Labels'),
    {
      kind: 'button',
      id: 'rich',
      label: () => 'Edges and reflections',
      hint: 'Draw edges, and a room that shiny parts reflect; on at first if the device has a graphics processor',
      on: () => app.rich,
      press: () => app.enrich(!app.rich),
    },
    {
      kind: 'button',
      id: 'look',
      label: () => 'Bright, for additive displays',
      hint: 'Brighter colours without a background, for glasses that add light to the room',
      on: () => app.world.look === 'additive',
      press: () => app.setLook(app.world.look === 'additive' ? 'normal' : 'additive'),
    },
  ]);
  const controls: Control[] = [
    { kind: 'head', text: 'Show' },
    ...rows.filter((r) => r.length).map((items): Control => ({ kind: 'row', items })),
  ];
  controls.push({ kind: 'text', id: 'drawn-notes', tone: () => 'faint', text: () => app.drawn.notes });
  controls.push({ kind: 'text', id: 'patient', tone: () => 'faint', text: () => app.overlays.sceneryText(m.robot) });
  controls.push({ kind: 'text', id: 'cloud', tone: () => 'faint', text: () => app.cloudText() });
  if (m.info?.variants.length)
    controls.push(
      {
        kind: 'choice',
        id: 'variant',
        label: 'Ghost of the equations: variant',
        hint: 'Show where a variant of the equations, such as the printed one, expects the tool',
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
      hint: 'Show everything smaller or larger',
      range: () => [-1, 1],
      get: () => Math.log10(app.place.scale),
      set: (v) => app.place.setScale(10 ** v),
      show: (v) => `${(10 ** v).toFixed(2)}×`,
    },
    {
      kind: 'slider',
      id: 'yaw',
      label: 'Turn',
      hint: 'Turn everything about the vertical',
      range: () => [-Math.PI, Math.PI],
      get: () => app.place.yaw,
      set: (v) => app.place.setYaw(v),
      show: (v) => `${((180 / Math.PI) * v).toFixed(0)}°`,
    },
    {
      kind: 'slider',
      id: 'height',
      label: 'Height',
      hint: 'Lift or lower everything',
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
          hint: 'Point at the floor of your room to place the robot there; only in AR, with a headset',
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
          hint: 'Pinch to move the whole robot, with both hands to turn and scale it; only in a headset',
        },
        { kind: 'button', id: 'reset', label: () => 'Reset', hint: 'Back to the size and place at the start', press: () => app.place.reset() },
      ],
    },
  );
  return { id: 'scene', label: 'Scene', hint: 'What is shown, and its size and place', controls };
}

export function robot(app: App): Tab {
  const m = app.model;
  const assumed = [...(m.info?.assumed ?? []), ...(m.scene?.assumed ?? [])];
  const count = assumed.length;
  return {
    id: 'robot',
    label: 'Robot',
    hint: 'Joint values, connection, and numbers without a source',
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
