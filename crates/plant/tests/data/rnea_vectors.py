"""Joint torques of random states by Pinocchio, an independent implementation: needs `pip install pin`."""
import sys

import numpy
import pinocchio

ORDER = ["torso_lift_joint", "head_1_joint", "head_2_joint"] + [
    f"arm_{side}_{i}_joint" for side in ("left", "right") for i in range(1, 8)
]
model = pinocchio.buildModelFromUrdf(sys.argv[1])
model.gravity.linear = numpy.array([0.0, 0.0, -9.80665])
for side in ("left", "right"):
    frame = model.frames[model.getFrameId(f"hand_{side}_grasping_frame")]
    payload = pinocchio.Inertia(0.7, numpy.zeros(3), numpy.zeros((3, 3)))
    model.appendBodyToJoint(frame.parentJoint, payload, frame.placement)
data = model.createData()
index = [model.joints[model.getJointId(name)].idx_v for name in ORDER]
rng = numpy.random.default_rng(1)
print(f"# q, v, a, torque of 17 joints; 0.7 kg in each grasping frame. Pinocchio {pinocchio.__version__}, made by:")
print("# python3 crates/plant/tests/data/rnea_vectors.py config/robots/tiago_dual.urdf")
for _ in range(20):
    q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
    v = rng.uniform(-2.0, 2.0, model.nv)
    a = rng.uniform(-8.0, 8.0, model.nv)
    torque = pinocchio.rnea(model, data, q, v, a)
    for values in (q, v, a, torque):
        print(" ".join(repr(float(values[i])) for i in index))
