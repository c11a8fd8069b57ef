import sys
from collections import Counter
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
counts, log, tf, joints, scene = Counter(), [], None, None, None
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    topics = [c.topic for c in reader.get_summary().channels.values() if c.message_encoding == "protobuf"]
    for schema, channel, message, decoded in reader.iter_decoded_messages(topics=topics):
        counts[schema.name] += 1
        if channel.topic == "/log":
            log.append(decoded.message)
        elif channel.topic == "/tf":
            tf = decoded
        elif channel.topic == "/joint_states/command":
            joints = decoded
        elif channel.topic == "/scene/robot":
            scene = decoded
print(sorted(counts))
print(log)
print("links", sorted(t.child_frame_id for t in tf.transforms))
print("joints", len(joints.joints), joints.joints[0].name, all(abs(j.position) < 10 for j in joints.joints))
print("capsules", len(scene.entities[0].cylinders) > 10)
