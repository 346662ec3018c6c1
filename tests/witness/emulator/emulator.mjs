// WebXR without a headset, for the tests of the page: IWER devices of three kinds, and a room that can be hit-tested.
// Bundled when the tests run and put before the page's own script; never part of what is shipped.
import { SyntheticEnvironmentModule } from '@iwer/sem';
import room from '@iwer/sem/captures/office_small.json';
import { metaQuest3, XRDevice } from 'iwer';

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

globalThis.emulate = (profile, withRoom) => {
  const device = new XRDevice(PROFILES[profile], { stereoEnabled: false });
  device.installRuntime({ forceInstall: true }); // or Chromium's own navigator.xr wins
  if (profile === 'lens') device.primaryInputMode = 'hand';
  if (withRoom) {
    device.installSEM(SyntheticEnvironmentModule);
    device.sem.loadEnvironment(room);
  }
  globalThis.device = device;
};
