"""Joint accelerations of random states by Pinocchio, an independent implementation: needs `pip install pin`."""
import sys

import numpy
import pinocchio

ORDER = ["torso_lift_joint", "head_1_joint", "head_2_joint"] + [
    f"arm_{side}_{i}_joint" for side in ("left", "right") for i in range(1, 8)
]
model = pinocchio.buildModelFromUrdf(sys.argv[1])
model.gravity.linear = numpy.array([0.0, 0.0, -9.80665])
index = [model.joints[model.getJointId(name)].idx_v for name in ORDER]
for rank, i in enumerate(index):
    model.armature[i] = 0.01 * (rank + 1)
data = model.createData()
rng = numpy.random.default_rng(2)
print(f"# q, v, torque, acceleration of 17 joints, armature of joint j: 0.01 (j + 1). Pinocchio {pinocchio.__version__}:")
print(f"# python3 crates/plant/tests/data/aba_vectors.py {sys.argv[1]}")
for _ in range(10):
    q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
    v = rng.uniform(-2.0, 2.0, model.nv)
    torque = rng.uniform(-0.1, 0.1, model.nv) * model.upperEffortLimit + pinocchio.computeGeneralizedGravity(model, data, q)
    a = pinocchio.aba(model, data, q, v, torque)
    for values in (q, v, torque, a):
        print(" ".join(repr(float(values[i])) for i in index))
