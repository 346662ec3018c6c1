/**
 * What the server says and hears. Lengths in m, angles in rad, poses as x y z qx qy qz qw, z up. What is said of a robot
 * is in its base; what is said of the scene is in world.
 */

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
  /** Where it stands in world. */
  T_world_base: Numbers;
  /** Folder of its files, empty or with a slash at its end. */
  files: string;
  /** Through which it works in the scene. */
  ports: { trocar: string; name: string; at: Numbers }[];
}

export interface FieldInfo {
  name: string;
  /** Base64 of u32, three for each triangle. */
  triangles: string;
  color: Numbers;
  opacity: number;
}

export interface CameraInfo {
  name: string;
  robot: string;
  link: string;
  T_link_camera: Numbers;
  /** Angle of view in rad. */
  view: number;
}

/** Hands that lead robots, and the camera that both drag. */
export interface ConsoleInfo {
  /** Robots of each hand, in the order of taps. */
  hands: Record<Side, string[]>;
  camera: string;
  /** Smallest and largest motion scale. */
  scale: Numbers;
  /** Seconds without a message after which nothing moves. */
  patience: number;
}

export type Side = 'right' | 'left';

/** Hands by UDP. */
export interface PacketsState {
  port: number;
  /** Address that leads each hand. */
  from: Record<Side, string | null>;
  /** Packets that never came in time. */
  lost: Record<Side, number>;
  /** Packets that came and were not used. */
  ignored: number;
}

/** The motion scale by MQTT. */
export interface MqttState {
  broker: string;
  topic: string;
  connected: boolean;
  problem: string | null;
}

/** Owner of the hands that packets lead. */
export const UDP = 'udp';

export interface ConsoleState {
  /** A client of the stream, or UDP. */
  owner: string | null;
  /** Number of the message that is answered by this state. */
  heard: number;
  silent: boolean;
  mode: 'instruments' | 'nothing' | 'camera';
  scale: number;
  hands: Record<Side, { robot: string; follows: boolean; wall: string | null; jumps: number }>;
  /** Which limit the camera is at. */
  camera: string | null;
  /** Of the World against the clock. */
  rate: number;
  stopped: string | null;
  /** Which pedal has been pressed for so long that it may be stuck. */
  pedal: string | null;
  packets: PacketsState | null;
  mqtt: MqttState | null;
}

/** One robot or several, and the props. */
export interface SceneInfo {
  schema: string;
  version: number;
  name: string;
  title: string;
  model_hash: string;
  robots: RobotInfo[];
  props: { name: string; file: string } | null;
  cameras: CameraInfo[];
  fields: FieldInfo[];
  assumed: string[];
  console?: ConsoleInfo;
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
  | { type: 'hello'; protocol: number; client: string | number; model_hash: string; resume?: string }
  | ({ type: 'state'; robots?: ({ name: string } & Partial<State>)[]; console?: ConsoleState } & Partial<State>)
  | { type: 'path'; robot?: string; protocol: string | null; points: Numbers }
  | { type: 'cloud'; robot?: string; first?: boolean; points: string; values?: string; done: boolean }
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
