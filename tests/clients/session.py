import sys
sys.path.insert(0, sys.argv[1])
import own_person
from package.client import rate
from package.session import Session
with Session(sys.argv[1]) as session:
    for i in rate(60):
        session.publish(own_person.at(i))
        if session.mode == 'Engaged': break
    print(session.mode, session.sentence)
