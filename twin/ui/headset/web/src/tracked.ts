/** Measurements of a controller or a bare hand by the headset: pose, gripper and pedals. */

import { Quaternion, Vector3 } from 'three';

export interface Tracked {
  p: Vector3;
  q: Quaternion;
  /** Opening of the gripper, 0 to 1. */
  open: number;
  clutch: boolean;
  camera: boolean;
  /** Whether the pedal of planning mode is pressed. */
  plan: boolean;
  /** Whether a bare hand is a fist; false for a controller. */
  fist: boolean;
}

/** Button indices of a controller in the layout `xr-standard`. */
const TRIGGER = 0;
const SQUEEZE = 1;
const STICK = 3;
const BUTTON = 4; // A or X
const UPPER = 5; // B or Y

/** Distance in m between the tips of thumb and index finger for a closed and an open gripper. */
const SHUT = 0.015;
const OPEN = 0.07;

const FINGERS = ['index', 'middle', 'ring', 'pinky'] as const;

/** Return the measurements of an input source; null while it is not tracked. */
export function track(frame: XRFrame, space: XRReferenceSpace, source: XRInputSource): Tracked | null {
  if (frame.session.visibilityState && frame.session.visibilityState !== 'visible') return null;
  return source.hand ? bareHand(frame, space, source.hand) : controller(frame, space, source);
}

function controller(frame: XRFrame, space: XRReferenceSpace, source: XRInputSource): Tracked | null {
  const pose = source.gripSpace && frame.getPose(source.gripSpace, space);
  const buttons = source.gamepad?.buttons;
  // An emulated position is an estimate by the device, because the controller is out of its sight.
  if (!pose || pose.emulatedPosition || !buttons) return null;
  const pressed = (k: number) => buttons[k]?.pressed ?? false;
  return {
    ...placed(pose.transform),
    open: 1 - (buttons[TRIGGER]?.value ?? 0),
    clutch: pressed(SQUEEZE),
    camera: pressed(STICK) || pressed(BUTTON),
    plan: pressed(UPPER),
    fist: false,
  };
}

/** Position from the knuckle of the index finger, which a pinch moves less than the wrist; orientation from the wrist. */
function bareHand(frame: XRFrame, space: XRReferenceSpace, hand: XRHand): Tracked | null {
  const at = (name: string): XRRigidTransform | null => {
    const joint = hand.get(name as XRHandJoint);
    return (joint && frame.getJointPose?.(joint, space)?.transform) ?? null;
  };
  const point = (name: string): Vector3 | null => {
    const T = at(name);
    return T && placed(T).p;
  };
  const wrist = at('wrist');
  const [thumb, index] = [point('thumb-tip'), point('index-finger-tip')];
  const knuckles = FINGERS.map((f) => point(`${f}-finger-phalanx-proximal`));
  const tips = FINGERS.map((f) => point(`${f}-finger-tip`));
  const knuckle = knuckles[0];
  if (!wrist || !thumb || !index || !knuckle) return null;
  const { p: root, q } = placed(wrist);
  // In a fist, the tips of all four fingers are nearer to the wrist than their knuckles are.
  const fist = tips.every((tip, i) => {
    const joint = knuckles[i];
    return tip && joint && tip.distanceTo(root) < joint.distanceTo(root);
  });
  const open = Math.min(1, Math.max(0, (thumb.distanceTo(index) - SHUT) / (OPEN - SHUT)));
  return { p: knuckle, q, open, clutch: false, camera: false, plan: false, fist };
}

function placed({ position, orientation }: XRRigidTransform): { p: Vector3; q: Quaternion } {
  return {
    p: new Vector3(position.x, position.y, position.z),
    q: new Quaternion(orientation.x, orientation.y, orientation.z, orientation.w),
  };
}
