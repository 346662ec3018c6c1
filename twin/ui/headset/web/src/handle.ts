/** A blue ball at a robot's tool, which is easier to point at than the tool. */

import { Group, Matrix4, Mesh, SphereGeometry, TorusGeometry } from 'three';
import { BLUE, flat } from './ink';

export class Handle {
  readonly group = new Group();
  readonly ball = new Mesh(new SphereGeometry(1, 24, 16), flat(BLUE, 0.35));
  private readonly ring = new Mesh(new TorusGeometry(1.25, 0.09, 8, 40), flat(BLUE));

  constructor() {
    this.group.add(this.ball, this.ring);
    for (const part of [this.ball, this.ring]) {
      part.material.depthTest = false; // visible also behind the tool
      part.renderOrder = 4;
    }
    this.group.visible = false;
    this.ball.userData['twinHandle'] = true;
  }

  put(tool: Matrix4, radius: number, color: number): void {
    tool.decompose(this.group.position, this.group.quaternion, this.group.scale);
    this.group.scale.setScalar(radius);
    for (const part of [this.ball, this.ring]) part.material.color.setHex(color);
  }
}
