import sys, time
from teleopd_client import CHUNK_DROPS, Policy
with Policy(sys.argv[1]) as policy:
    rows = [policy.observe().commanded[:len(policy.joints)]]
    for _ in range(500):
        policy.publish(rows, rate_hz=20)
        time.sleep(0.001)
    why = [policy.dropped().split(':')[0]]
    counts = zip(CHUNK_DROPS, policy.observe().chunks_dropped)
    print(sorted(why + [reason.split(':')[0] for reason, count in counts if count]))
