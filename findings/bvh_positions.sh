#!/usr/bin/env bash
# Packages:  bvhio 1.5.4 and bvhsdk 0.2.1 (PyPI), three 0.187.0 (npm: BVHLoader)
# Guess:     a joint with position channels is at one place, whichever reader of BVH one takes.
# Behaviour: the format does not say whether a position replaces the joint's OFFSET or is added to it. bvhio and bvhsdk
#            replace, three.js adds. The hips of one file are at a height of 92 or of 182, and an arm bone has a length
#            of 10 or of 20. Files in which each OFFSET or each position is zero hide it.
# Seen:      2026-11-28, Python 3.11, node 20. Output (Hips, Arm):
#            bvhio: [1.0, 92.0, 3.0] [11.0, 92.0, 3.0]
#            bvhsdk: [1.0, 92.0, 3.0] [11.0, 92.0, 3.0]
#            three: [1, 182, 3] [21, 182, 3]
# Takes:     60 s.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check bvhio==1.5.4 bvhsdk==0.2.1
npm install --silent --no-audit --no-fund --prefix "$work" three@0.187.0 >/dev/null

cat > person.bvh <<'BVH'
HIERARCHY
ROOT Hips
{
  OFFSET 0 90 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Arm
  {
    OFFSET 10 0 0
    CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 5 0 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
1 92 3 0 0 0 10 0 0 0 0 0
1 92 3 0 0 0 10 0 0 0 0 0
BVH
cat > read.py <<'PY'
import bvhio, bvhsdk

hierarchy = bvhio.readAsHierarchy("person.bvh")
hierarchy.loadPose(0)
print("bvhio:", *[[round(float(x), 3) for x in joint.PositionWorld] for joint, _, _ in hierarchy.layout()])
root = bvhsdk.ReadFile("person.bvh").root
print("bvhsdk:", *[[float(x) for x in joint.getPosition(0)] for joint in (root, *root.children)])
PY
cat > read.mjs <<'JS'
import { readFileSync } from "node:fs";
import { AnimationMixer, Vector3 } from "three";
import { BVHLoader } from "three/examples/jsm/loaders/BVHLoader.js";

const { skeleton, clip } = new BVHLoader().parse(readFileSync("person.bvh", "utf8"));
const [hips, arm] = skeleton.bones;
const mixer = new AnimationMixer(hips);
mixer.clipAction(clip).play();
mixer.setTime(0);
hips.updateMatrixWorld(true);
const place = (bone) => `[${new Vector3().setFromMatrixPosition(bone.matrixWorld).toArray().join(", ")}]`;
console.log("three:", place(hips), place(arm));
JS
{ venv/bin/python read.py; node read.mjs; } > seen.txt
cat seen.txt
if ! diff -q seen.txt - >/dev/null <<'SEEN'
bvhio: [1.0, 92.0, 3.0] [11.0, 92.0, 3.0]
bvhsdk: [1.0, 92.0, 3.0] [11.0, 92.0, 3.0]
three: [1, 182, 3] [21, 182, 3]
SEEN
then
  echo "CHANGED: the readers place the joints in another way" >&2
  exit 1
fi
echo "as stated: two readers replace the OFFSET by the position, one adds both"
