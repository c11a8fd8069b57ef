import json, sys, time
sys.path.insert(0, sys.argv[2])
import own_person
from teleopd_client import MODES, FeedbackReader, SkeletonPublisher, lease_is_held, rate, sentence
held = [lease_is_held(sys.argv[1])]
with SkeletonPublisher(sys.argv[1]) as publisher, FeedbackReader(sys.argv[1]) as reader:
    engaged = None
    for i in rate(60):
        closed = engaged is not None and i > engaged + 60
        publisher.publish(own_person.at(i), closure=(0.5 if closed else 0.0, None))
        feedback = reader.latest()
        if feedback is None: continue
        if engaged is None and MODES[feedback.mode] == 'Engaged': engaged = i
        if feedback.closure[0] > 0.4: break
    held.append(lease_is_held(sys.argv[1]))
    print(json.dumps({'held': held, 'sentence': sentence(feedback), 'clearance_m': list(feedback.clearance_m), 'known': feedback.known,
        'closure': list(feedback.closure), 'towards': [list(way) for way in feedback.towards_nearest]}))
