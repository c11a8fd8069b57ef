import json, sys, time
import numpy as np
sys.path.insert(0, sys.argv[1])
import messages as m
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
lo = '<Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces>'
domain = Domain(int(sys.argv[2]), f'<CycloneDDS><Domain><General>{lo}</General></Domain></CycloneDDS>')
us = DomainParticipant(int(sys.argv[2]))
states = DataReader(us, Topic(us, 'rt/joint_states', m.JointState), m.READER_RELIABLE)
description = DataReader(us, Topic(us, 'rt/robot_description', m.String), m.LATCHED)
heard, urdf, end = [], '', time.monotonic() + 20
while time.monotonic() < end:
    new = [(time.time(), state) for state in states.take(100)]
    end = min(end, time.monotonic() + 2) if new and not heard else end
    heard += new
    urdf = ''.join(text.data for text in description.take(1)) or urdf
    time.sleep(0.005)
stamps = [state.header.stamp.sec + state.header.stamp.nanosec * 1e-9 for _, state in heard]
time_s, q, v = (np.array(all) for all in (stamps, [state.position for _, state in heard], [state.velocity for _, state in heard]))
# Positions are the integral of the velocities beside them.
path = np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(time_s)[:, None], axis=0)
print(json.dumps({'urdf': urdf, 'count': len(heard), 'names': heard[-1][1].name, 'is_ordered': stamps == sorted(set(stamps)),
    'age_s': sorted(at - stamp for (at, _), stamp in zip(heard, stamps))[len(heard) // 2],
    'moved': abs(path).max(), 'off': abs(q[1:] - q[0] - path).max()}))
