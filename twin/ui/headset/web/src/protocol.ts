/** What the server says and hears. Lengths in m, angles in rad, poses as x y z qx qy qz qw, world with z up. */

export type Numbers = readonly number[];

export interface JointInfo {
  name: string;
  type: string;
  unit: string;
  lower: number | null;
  upper: number | null;
  active: boolean;
  link: string;
  parent: string;
  /** A point of the axis and its direction, in the frame of the parent link. */
  axis: { origin: Numbers; direction: Numbers };
}

/** Who lies at the RCM of each protocol, /patient/<protocol>.glb, or why nobody does. */
export interface Scenery {
  floor: number;
  patients: Record<string, { replaces: string[]; assumed: string }>;
  no_patient: Record<string, string>;
}

export interface Named {
  name: string;
  title: string;
  is_default?: boolean;
}

export interface RobotInfo {
  schema: string;
  version: number;
  name: string;
  title?: string;
  model_hash: string;
  links: string[];
  joints: JointInfo[];
  tool: { link: string; T_link_tool: Numbers };
  protocols: Named[];
  postures: string[];
  variants: string[];
  has_equations: boolean;
  has_workspace: boolean;
  scenery: Scenery | null;
  assumed: string[];
}

export type Phase = readonly [name: string, start: number, end: number];

export interface State {
  playing: boolean;
  time: number;
  duration: number;
  speed: number;
  loop: boolean;
  protocol: string | null;
  phases: Phase[];
  phase: string | null;
  holder: string | number | null;
  reason: string | null;
  gap_m: number | null;
  residual_m: number | null;
  /** Instead of residual_m, if what differs most is an angle. */
  residual_rad: number | null;
  /** Why equations and mechanism cannot be compared here. */
  scope: string | null;
  rcm: Numbers | null;
  rcm_error_m: number | null;
  depth_m: number | null;
  /** The instruments in their trocars; `rcm` is the first of them. */
  trocars: { name: string; at: Numbers; error_m: number | null; depth_m: number | null }[];
  variant: string | null;
  planning: string | null;
  workspace: boolean;
  /** Only where the server was started with --record. */
  recording?: boolean;
  postures: string[];
}

export type Message =
  | { type: 'hello'; protocol: number; client: string | number; robot: string; model_hash: string; resume?: string }
  | ({ type: 'state' } & Partial<State>)
  | { type: 'path'; protocol: string | null; points: Numbers }
  | { type: 'cloud'; first?: boolean; points: string; values?: string; done: boolean }
  | { type: 'error'; id?: number; code: string; message: string }
  | { type: 'ack'; id?: number }
  | { type: 'pong'; t: number };

export const FIRST_STATE: State = {
  playing: false,
  time: 0,
  duration: 0,
  speed: 1,
  loop: true,
  protocol: null,
  phases: [],
  phase: '',
  holder: null,
  reason: '',
  gap_m: null,
  residual_m: null,
  residual_rad: null,
  scope: null,
  rcm: null,
  rcm_error_m: null,
  depth_m: null,
  trocars: [],
  variant: null,
  planning: null,
  workspace: false,
  postures: [],
};
