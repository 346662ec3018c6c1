/**
 * Messages from and to the server. Lengths in m, angles in rad, poses as x y z qx qy qz qw, z up. Data of a robot are in
 * its base frame, data of the scene in the world frame.
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
  /** A point and the direction of the axis, in the frame of the parent link. */
  axis: { origin: Numbers; direction: Numbers };
}

/** Patient of each protocol (file /patient/<protocol>.glb), or the reason for its absence. */
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
  /** Distances of joints that can be changed, in m. */
  distances: { name: string; drawn: number; lower: number; upper: number }[];
  has_equations: boolean;
  /** Largest difference in m or rad at which equations and mechanism agree. */
  live_tolerance: number;
  has_workspace: boolean;
  scenery: Scenery | null;
  assumed: string[];
  /** Pose of the base in the world frame. */
  T_world_base: Numbers;
  /** Folder of the robot's files; empty, or with a slash at its end. */
  files: string;
  /** Ports of the robot's instruments in the scene. */
  ports: { trocar: string; name: string; at: Numbers }[];
}

export interface FieldInfo {
  name: string;
  /** Base64 of u32 vertex indices, three for each triangle. */
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
  /** Stereo: distance in m between the lenses, and to the intersection of their lines of sight. */
  stereo?: [baseline: number, converge: number];
  /** Grey line in the middle of the picture: its length divided by the height of the picture. */
  line?: number;
}

/** Console: robots of both hands, and the camera that both hands move. */
export interface ConsoleInfo {
  /** Robots of each hand, in the order in which taps select them. */
  hands: Record<Side, string[]>;
  camera: string;
  /** Smallest and largest motion scale. */
  scale: Numbers;
  /** Time in s without a message after which nothing moves. */
  patience: number;
  /** Whether the hands can move the outer ends of the instruments. */
  fulcrum: boolean;
  /** Whether there is a task to end or restart. */
  task: boolean;
  /** Whether the gripper of a hand moves a jaw. */
  jaws: Record<Side, boolean>;
  /** The pedal lets the hands go ("clutch"), or the robot follows only while it is pressed ("enable"). */
  pedal: 'clutch' | 'enable';
  /** Numbers to show in the camera's picture, and their positions in m in the world frame. */
  marks: [text: string, at: Numbers][];
  /** Whether other content follows at this address: in a guided run of a study, or when a page starts a task. */
  guided: boolean;
  /** What people call the instrument of each robot, such as "the left instrument". */
  called: Record<string, string>;
  /** Tasks that a page can start, and the present one; null if the server shows only one exercise. */
  choice: { tasks: [name: string, title: string][]; present: string | null } | null;
  /** Questionnaires that the page asks. */
  questionnaires: QuestionnaireInfo[];
  /** The motion scale at the start. */
  first_scale: number;
  tools: ToolInfo[];
}

/** A questionnaire: its items, the answers from `low` to `high` in steps, and the words at both ends. */
export interface QuestionnaireInfo {
  name: string;
  title: string;
  items: string[];
  low: number;
  high: number;
  step: number;
  ends: [string, string];
  /** Whether pairs of items can be compared, for weights. */
  pairs: boolean;
}

/** A tool that an instrument can hold. */
export interface ToolInfo {
  name: string;
  title: string;
  kind: 'grasper' | 'scissors' | 'clip_applier' | 'scalpel' | 'cautery';
  does: string;
  /** Length of the jaws or blades, and gap between the open jaws (0 without jaws), in m. */
  jaw: number;
  open: number;
}

/** Machines of a scene, each with its model beside it. */
export interface MachinesInfo {
  /** Name of the model of each machine. */
  models: Record<string, string>;
  /** Name of each joint, and whether it is an angle. */
  joints: Record<string, [string, boolean][]>;
  /** Distance of the tips in m above which there is a cue; null: there is none. */
  limit: number | null;
  /** Whether a trainer moves them. */
  trains: boolean;
}

export interface MachineState {
  /** Run level; null if the machine does not answer. */
  level: string | null;
  phase: 'teleoperate' | 'rehearse' | 'judged' | 'replay' | 'done' | 'stopped' | 'follow';
  /** Why a record is refused, or a replay was stopped. */
  why: string | null;
  /** Why the machine cannot be moved. */
  problem: string | null;
}

export interface MachinesState {
  view: 'real' | 'virtual';
  mode: string;
  robots: Record<string, MachineState>;
}

export type Side = 'right' | 'left';

/** Hands by UDP. */
export interface PacketsState {
  port: number;
  /** Address of the sender that controls each hand. */
  from: Record<Side, string | null>;
  /** Number of packets of each hand that did not arrive in time. */
  lost: Record<Side, number>;
  /** Number of received packets that were not used. */
  ignored: number;
}

/** The motion scale by MQTT. */
export interface MqttState {
  broker: string;
  topic: string;
  connected: boolean;
  problem: string | null;
}

/** Identifier of the owner while UDP packets control the hands. */
export const UDP = 'udp';

/** One hand at the console. */
export interface HandState {
  robot: string;
  follows: boolean;
  wall: string | null;
  jumps: number;
  /** The chosen tool. */
  tool?: string;
  /** In a procedure: the tool that the instrument carries. */
  carries?: string;
  /** In a procedure: why it does not carry the chosen tool yet. */
  waits?: string | null;
  /** In a procedure: whether the jaws are open. */
  open?: boolean;
  /** In a procedure: whether the tool gives off energy. */
  active?: boolean;
}

/** Planning mode of an arm. */
export interface PlanState {
  phase: 'off' | 'aim' | 'plan' | 'preview' | 'run';
  hand: Side | '';
  robot: string;
  said: string;
  /** Whether `said` is an error. */
  bad: boolean;
  /** Why the target is not free. */
  blocked: string;
  /** Whether the geometry is loaded. */
  ready: boolean;
  /** Part of the search, or of the motion, that is done. */
  done: number;
}

export interface ConsoleState {
  /** Identifier of the controlling client, or `UDP`. */
  owner: string | null;
  /** Number of the last message that this state includes. */
  heard: number;
  silent: boolean;
  mode: 'instruments' | 'nothing' | 'camera';
  scale: number;
  /** Whether the forces on the hands are switched on. */
  haptics: boolean;
  /** The hands that move robots; a console with one hand has no left one. */
  hands: Partial<Record<Side, HandState>>;
  /** Which end of the instruments the hands move: the tip, or the outer end; null: the mechanism decides. */
  fulcrum: 'compensated' | 'direct' | null;
  /** Text on the camera's limit; null if it is at no limit. */
  camera: string | null;
  /** Speed of the World relative to real time. */
  rate: number;
  stopped: string | null;
  /** Whether the server prepares another task. */
  leaving: boolean;
  /** Text on a pedal that may be stuck, because it was pressed for a long time. */
  pedal: string | null;
  packets: PacketsState | null;
  mqtt: MqttState | null;
  /** Scoreboard of a task that is judged; null for other tasks. */
  task: TaskState | null;
  /** The questionnaire to answer now, and the number of those that are left; null: there is none. */
  form: { when: 'before' | 'after'; name: string; left: number } | null;
  /** Planning mode; null if there is nothing to show. */
  plan: PlanState | null;
}

export interface TaskState {
  title: string;
  /** Number of this attempt, from 1. */
  attempt: number;
  /** Why the attempt has ended; null while it lasts. */
  over: string | null;
  /** The newest report; null before the first. */
  report: { attempt: number; ready: boolean; problem: string } | null;
  rows: [what: string, value: string][];
  rings: [name: string, state: string, color: string][];
  /** Stages and checks of a procedure. */
  stages?: [title: string, state: 'done' | 'open' | 'failed', text: string][];
  /** What a procedure needs next. */
  next?: string;
  /** Whether the tip touches a hole now. */
  contact?: boolean;
  /** Number of holes that were touched in order. */
  done?: number;
  /** The last events. */
  events: [t: number, tone: 'good' | 'plain' | 'bad', text: string][];
}

/** Movable objects of a task: their file, and their names in the order of a frame. */
export interface ObjectsInfo {
  file: string;
  names: string[];
}

/** A scene: one or more robots, and the props. */
/** A cable between two bodies of a robot; lengths in m. */
export interface CableInfo {
  robot: string | null;
  ends: { link: string; at: Numbers }[];
  length: number;
  radius: number;
  color: Numbers;
}

/** What is drawn and not measured. */
export interface DrawnInfo {
  file: string | null;
  notes: string[];
  parts: { node: string; robot: string | null; link: string | null; pattern: string }[];
  cables: CableInfo[];
  finishes: { body: string; color: Numbers; pattern: string }[];
}

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
  machines?: MachinesInfo;
  objects?: ObjectsInfo;
  drawn?: DrawnInfo;
  /** A person beside the robots, for scale. */
  person?: { file: string; note: string };
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
  /** Largest difference if it is an angle; it then replaces residual_m. */
  residual_rad: number | null;
  /** Reason why equations and mechanism cannot be compared at this state. */
  scope: string | null;
  rcm: Numbers | null;
  rcm_error_m: number | null;
  depth_m: number | null;
  /** The instruments in their trocars; `rcm` is the first of them. */
  trocars: { name: string; at: Numbers; error_m: number | null; depth_m: number | null }[];
  variant: string | null;
  /** Distances that are not as drawn: index in the robot's description, value in m. */
  distances: [index: number, value: number][];
  planning: string | null;
  workspace: boolean;
  /** Only if the server was started with --record. */
  recording?: boolean;
  postures: string[];
  /** The machine that follows the robot: run level (null: no answer), distance in m of its tool from the hand, problem. */
  machine?: { level: string | null; behind: number | null; problem: string | null };
}

export type Message =
  | { type: 'hello'; protocol: number; client: string | number; model_hash: string; resume?: string }
  | ({ type: 'state'; robots?: ({ name: string } & Partial<State>)[]; console?: ConsoleState; machines?: MachinesState } & Partial<State>)
  | { type: 'forces'; right: Numbers; left: Numbers }
  | { type: 'deviations'; time: number; robots: Record<string, { tip: number; joints: number[]; cue: number }> }
  | { type: 'target'; robot: string; poses: string }
  | { type: 'plan'; robot: string; poses: string; tip: string; tree: string; every: number; duration: number }
  | { type: 'clearance'; robot: string; t: number[]; distance: number[]; proven: number | null; found: number | null; bodies: string[] }
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
  distances: [],
  planning: null,
  workspace: false,
  postures: [],
};
