// What dances on the stage: stick figures and bodies of colored voxels, each drawn in a call or two.
import { THREE } from "nicegui-scene";
import { headOf, linesOf } from "./figures.js";

export const FIELD_OF_VIEW = 36; // degrees
const up = new THREE.Vector3(0, 1, 0);

// One stick figure: a tube a line, a ball a joint, all of a kind drawn at once.
export class Figure {
  constructor(scene, joints, lines, top) {
    this.top = top; // the joint on top of the head is inside its ball
    const paint = new THREE.MeshLambertMaterial();
    this.tubes = new THREE.InstancedMesh(new THREE.CylinderGeometry(0.017, 0.017, 1, 8, 1, true), paint, lines);
    this.balls = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 14, 10), paint, joints + 1); // and the head
    this.group = new THREE.Group();
    for (const mesh of [this.tubes, this.balls]) {
      mesh.frustumCulled = false;
      mesh.setColorAt(0, new THREE.Color()); // makes room for colors
      this.group.add(mesh);
    }
    scene.add(this.group);
  }
  show(pose, color, faint, strong) {
    this.group.visible = Boolean(pose);
    if (!pose) return;
    const a = new THREE.Vector3(), b = new THREE.Vector3(), turn = new THREE.Quaternion(), size = new THREE.Vector3(), at = new THREE.Matrix4();
    const full = new THREE.Color(color), pale = new THREE.Color(faint);
    let tubes = 0, balls = 0;
    for (const [from, to] of linesOf(pose)) {
      a.fromArray(pose, 3 * from); b.fromArray(pose, 3 * to);
      const long = a.distanceTo(b);
      if (!(long > 1e-4)) continue;
      turn.setFromUnitVectors(up, b.clone().sub(a).normalize());
      this.tubes.setMatrixAt(tubes, at.compose(a.add(b).multiplyScalar(0.5), turn, size.set(1, long, 1)));
      this.tubes.setColorAt(tubes++, !strong || strong.has(from) || strong.has(to) ? full : pale);
    }
    const ball = (place, radius, joint) => {
      this.balls.setMatrixAt(balls, at.compose(a.fromArray(place), turn.identity(), size.setScalar(radius)));
      this.balls.setColorAt(balls++, !strong || strong.has(joint) ? full : pale);
    };
    for (let k = 0; 3 * k < pose.length; k++) if (k !== this.top && Number.isFinite(pose[3 * k])) ball(pose.slice(3 * k, 3 * k + 3), 0.027, k);
    const head = headOf(pose);
    if (head) ball(head.middle, head.radius, this.top);
    this.tubes.count = tubes; this.balls.count = balls;
    for (const mesh of [this.tubes, this.balls]) { mesh.instanceMatrix.needsUpdate = true; mesh.instanceColor.needsUpdate = true; }
  }
}

// One body of colored voxels: a square a voxel, of its size.
export class Body {
  constructor(scene) {
    this.material = new THREE.PointsMaterial({ vertexColors: true, sizeAttenuation: true, toneMapped: false });
    this.material.onBeforeCompile = (shader) => { // darker to the rim: squares of one color still show the body's shape
      shader.fragmentShader = shader.fragmentShader
        .replace("#include <color_fragment>", "#include <color_fragment>\nvec2 rim = gl_PointCoord * 2.0 - 1.0; diffuseColor.rgb *= 1.04 - 0.16 * dot(rim, rim);")
        .replace("#include <colorspace_fragment>", ""); // the colors are those of the screen already
    };
    this.points = new THREE.Points(new THREE.BufferGeometry(), this.material);
    this.points.frustumCulled = false;
    this.points.visible = false;
    scene.add(this.points);
    this.shown = "";
    this.room = 0;
  }
  show(voxels, { base, stand }, segmentColors, key) {
    this.points.visible = Boolean(voxels && base);
    if (!this.points.visible || this.shown === key) return;
    this.shown = key;
    const { count, place, color, label, palette, voxel_m } = voxels;
    if (count > this.room) { // the same memory for every frame
      this.room = Math.ceil(1.2 * count);
      this.points.geometry.dispose();
      this.points.geometry = new THREE.BufferGeometry();
      this.points.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * this.room), 3).setUsage(THREE.DynamicDrawUsage));
      this.points.geometry.setAttribute("color", new THREE.BufferAttribute(new Uint8Array(3 * this.room), 3, true).setUsage(THREE.DynamicDrawUsage));
    }
    const { position, color: painted } = this.points.geometry.attributes, rgb = painted.array;
    const table = segmentColors ? segmentColors.flat() : palette, which = segmentColors ? label : color;
    for (let i = 0; i < count; i++) { const from = 3 * which[i]; rgb[3 * i] = table[from]; rgb[3 * i + 1] = table[from + 1]; rgb[3 * i + 2] = table[from + 2]; }
    position.array.set(place);
    position.needsUpdate = painted.needsUpdate = true;
    this.points.geometry.setDrawRange(0, count);
    this.material.size = (1.25 * voxel_m) / Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180)); // three.js leaves the view out
    const turn = -base.turn, C = Math.cos(turn), S = Math.sin(turn);
    this.points.rotation.y = turn; // moves (x, z) to (C x + S z, C z - S x)
    this.points.position.set(stand.x - (C * base.x + S * base.z), 0, stand.z - (C * base.z - S * base.x));
  }
}
