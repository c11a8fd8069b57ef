import json, sys
from pythonosc.osc_bundle_builder import OscBundleBuilder, IMMEDIATELY
from pythonosc.osc_message_builder import OscMessageBuilder
bundle = OscBundleBuilder(IMMEDIATELY)
for address, values in json.load(sys.stdin):
    message = OscMessageBuilder(address)
    for value in values:
        message.add_arg(None if values[0] == "LeftHand" and value == 0 else value)
    bundle.add_content(message.build())
print(bundle.build().dgram.hex())
