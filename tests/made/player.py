"""A simulated gamepad player: it reads the drawn tips from the page, and steers them to positions in the World."""

from __future__ import annotations

import time

import numpy as np

from made import headset_page as headset
from made.console_page import PAD

SEE = """
window.player = {
  tip: (side) => twin.app.fields.group.worldToLocal(twin.app.console.tip(side)).toArray(),
  off: (side, goal) => {
    const scope = twin.app.console.views.scope, tip = twin.app.console.tip(side), to = tip.clone().fromArray(goal);
    scope.updateWorldMatrix(true, false);
    twin.app.fields.group.localToWorld(to);
    return scope.worldToLocal(to).sub(scope.worldToLocal(tip));
  },
};
"""
"""Script of a page: `tip` is a tip's position in the World in m; `off` is the vector from a tip to a position `goal`,
in the picture's axes (right, up, towards the lens)."""

STEER = (
    PAD
    + SEE
    + """
window.pad.connected = true;
window.steer = {right: null, left: null};
Object.assign(player, {
  left: {stick: 0, deeper: 12, nearer: 13, tapped: false, moved: []},
  right: {stick: 2, deeper: 3, nearer: 0, tapped: false, moved: []},
  press: (k, on) => { window.pad.buttons[k] = {pressed: on, value: Number(on)}; },
});
(function steer() {
  requestAnimationFrame(steer);
  const c = window.twin?.app?.console;
  if (!c || !c.tip('right')) return;
  const full = 0.08 * c.scale;
  for (const side of ['right', 'left']) {
    const me = player[side], goal = window.steer[side];
    let way = [0, 0, 0], depth = 0;
    const pen = c.pens[side], heard = twin.app.model.console.heard;
    me.moved.push({number: c.pens.number, p: pen.p.clone()}); // a person feels how far the own hand has moved
    while (me.moved.length > 1 && me.moved[1].number <= heard) me.moved.shift();
    if (goal) {
      const off = player.off(side, goal);
      off.addScaledVector(pen.p.clone().sub(me.moved[0].p), -c.scale); // of the motion that is not drawn yet
      const pace = Math.min(1, twin.app.model.console.rate); // slower hands for a slower World
      me.tapped = !me.tapped;
      depth = Math.abs(off.z) > 8e-3 * pace + 1e-3 || (Math.abs(off.z) > 1e-3 && me.tapped) ? Math.sign(off.z) : 0;
      way = off.multiplyScalar((3 * pace) / full).clampLength(0, pace).toArray();
    }
    const live = (v) => Math.abs(v) < 0.01 ? 0 : Math.sign(v) * (0.15 + 0.85 * Math.abs(v));
    window.pad.axes[me.stick] = live(way[0]);
    window.pad.axes[me.stick + 1] = live(-way[1]);
    player.press(me.deeper, depth < 0);
    player.press(me.nearer, depth > 0);
  }
})();
"""
)
"""Script of a page: a gamepad whose sticks and depth buttons move the tips to the positions in `window.steer`."""

_TRIGGER = {"left": 6, "right": 7}
_NEXT = {"left": 14, "right": 2}
_SIDES = 8  # number of corners of a vessel's prisms; the last vertex of each ring is its centre


class Player:
    """A person at the page of a procedure: reads positions from the page, and acts with a gamepad."""

    def __init__(self, page, ports):
        self.page, self.ports, self.tips = page, ports, {}

    # -- what is seen ----------------------------------------------------------------------------------------

    def tip(self, side):
        return np.array(self.page(f"player.tip('{side}')"))

    def vertices(self, name):
        return np.array(self.page(f"twin.app.fields.vertices('{name}')")).reshape(-1, 3)

    def line(self, vessel):
        """Return the centre line (n + 1, 3) of a vessel."""
        rings = self.vertices(vessel).reshape(-1, 2, _SIDES + 1, 3)[:, :, -1]
        return np.vstack([rings[:, 0], rings[-1:, 1]])

    def fundus(self, vessel):
        """Return the vertex (3,) in the upper part of the gallbladder that is farthest from the start of a vessel."""
        v = self.vertices("gallbladder")
        high = v[v[:, 2] > np.quantile(v[:, 2], 0.8)]
        return high[np.argmax(np.linalg.norm(high - self.line(vessel)[0], axis=1))]

    def place(self, vessel, part):
        """Return the point (3,) on the centre line of a vessel at the fraction `part`, 0 to 1, of its segments."""
        line = self.line(vessel)
        k = part * (len(line) - 1)
        i = min(int(k), len(line) - 2)
        return line[i] + (k - i) * (line[i + 1] - line[i])

    def marks(self):
        """Return the centres (k, 3) of the marks of the gallbladder bed that still exist."""
        corners = self.vertices("gallbladder_bed").reshape(-1, 6, 3)
        return corners.mean(axis=1)[np.ptp(corners, axis=1).max(axis=1) > 1e-3]

    def until_marks(self, count):
        headset.until(lambda: len(self.marks()) <= count, f"{count} cells of the bed are left")

    def inwards(self, side, p):
        way = p - self.ports[side]
        return way / np.linalg.norm(way)

    def stages(self):
        """Return the state of each stage of the task, by its title on the page."""
        return {s[0]: s[1] for s in self.page("twin.app.model.console.task.stages")}

    def hand(self, side):
        return self.page(f"twin.app.model.console.hands.{side}")

    # -- what is done ----------------------------------------------------------------------------------------

    def go(self, near=1.5e-3, **to):
        """Steer tips to positions (3,) in m in the World, all at once, until they are nearer than `near` in m."""
        for side, p in to.items():
            self.page(f"window.steer.{side} = {np.asarray(p).tolist()}")

        def there():
            return all(np.linalg.norm(self.tip(side) - p) < near for side, p in to.items())

        headset.until(there, f"the tips reach {to}", 120)
        for side in to:
            self.page(f"window.steer.{side} = null")

    def approach(self, side, see, before=15e-3):
        """Move a tip along the shaft to the position returned by `see`, which may change during the motion."""
        p = see()
        self.go(4e-3, **{side: p - before * self.inwards(side, p)})
        self.go(**{side: see()})

    def back(self, side, way=15e-3):
        p = self.tip(side)
        self.go(5e-3, **{side: p - way * self.inwards(side, p)})

    def press(self, button, on=True):
        self.page(f"player.press({button}, {str(on).lower()})")

    def pull(self, side):
        """Pull the trigger and wait until the jaws open."""
        self.press(_TRIGGER[side])
        self.page.until(f"twin.app.console.pens.{side}.gripped > 0.6", "the trigger is pulled")
        heard = self.page("twin.app.model.console.heard")
        self.page.until(
            f"twin.app.model.console.heard > {heard + 5} && twin.app.model.console.hands.{side}.open", "the jaws open"
        )

    def release(self, side):
        self.press(_TRIGGER[side], False)
        self.page.until(f"!twin.app.model.console.hands.{side}.open", "the jaws close")

    def snap(self, side):
        self.pull(side)
        self.release(side)

    def take(self, side, tool, change=0.11):
        """Retract a tip to its port, and select the next tool until it is `tool`.

        `change` in m is the depth below the port up to which tools can be changed.
        """
        self.back(side)
        port, p = self.ports[side], self.tip(side)
        self.go(4e-3, **{side: port + 0.85 * change * self.inwards(side, p)})
        for _ in range(8):
            if (chosen := self.hand(side)["tool"]) == tool:
                break
            self.press(_NEXT[side])
            self.page.until(f"twin.app.model.console.hands.{side}.tool !== '{chosen}'", "the next tool")
            self.press(_NEXT[side], False)
            time.sleep(0.1)
        self.page.until(f"twin.app.model.console.hands.{side}.carries === '{tool}'", f"{side} carries {tool}")
