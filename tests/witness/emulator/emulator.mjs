// WebXR without a headset, for the tests of the page: IWER devices of three kinds, and a room that can be hit-tested.
// Bundled when the tests run and put before the page's own script; never part of what is shipped.
import { SyntheticEnvironmentModule } from '@iwer/sem';
import room from '@iwer/sem/captures/office_small.json';
import { metaQuest3, P_HAND_INPUT, P_SPACE, XRDevice } from 'iwer';

const WITHOUT_AR = metaQuest3.supportedSessionModes.filter((mode) => mode !== 'immersive-ar');

const PROFILES = {
  quest: metaQuest3,
  // Like a HoloLens 2: light is added to the room, there are hands and no controllers.
  lens: {
    ...metaQuest3,
    name: 'additive glasses',
    controllerConfig: undefined,
    environmentBlendModes: { 'immersive-ar': 'additive', 'immersive-vr': 'opaque' },
    internalNominalFrameRate: 60,
    supportedFrameRates: [60],
  },
  vr: { ...metaQuest3, name: 'VR only', supportedSessionModes: WITHOUT_AR },
};

/** A pose that the emulator lacks: the fingers bent into the palm, which is along -y; they point along -z. */
function fist(poses) {
  const jointTransforms = { ...poses.default.jointTransforms };
  for (const finger of ['index-finger', 'middle-finger', 'ring-finger', 'pinky-finger']) {
    const knuckle = jointTransforms[`${finger}-phalanx-proximal`].offsetMatrix;
    const bent = { 'phalanx-intermediate': [-0.01, -0.03], 'phalanx-distal': [-0.035, -0.01], tip: [-0.035, 0.02] };
    for (const [joint, [y, z]] of Object.entries(bent)) {
      const name = `${finger}-${joint}`;
      const offsetMatrix = [...jointTransforms[name].offsetMatrix];
      [offsetMatrix[12], offsetMatrix[13], offsetMatrix[14]] = [knuckle[12], knuckle[13] + y, knuckle[14] + z];
      jointTransforms[name] = { ...jointTransforms[name], offsetMatrix };
    }
  }
  return { ...poses.default, jointTransforms };
}

globalThis.emulate = (profile, withRoom) => {
  const device = new XRDevice(PROFILES[profile], { stereoEnabled: false });
  device.installRuntime({ forceInstall: true }); // or Chromium's own navigator.xr wins
  // The emulator calls every position a guess, which a real device does of a controller that it does not see.
  globalThis.guess = (side, on) => (device.controllers[side].inputSource.gripSpace[P_SPACE].emulated = on);
  for (const side of Object.keys(device.controllers)) guess(side, false);
  for (const hand of Object.values(device.hands)) {
    const { poses } = hand[P_HAND_INPUT];
    poses.fist ??= fist(poses);
  }
  if (profile === 'lens') device.primaryInputMode = 'hand';
  if (withRoom) {
    device.installSEM(SyntheticEnvironmentModule);
    device.sem.loadEnvironment(room);
  }
  globalThis.device = device;
};
