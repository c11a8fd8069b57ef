//! The shipped robot.

mod support;

use robot::Frames;
use support::shipped;

#[test]
fn home_is_five_centimetres_clear_of_itself() {
    let model = shipped();
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    let (clearance_m, pair) = model.clearance(&frames);
    let pair = model.pairs[pair];
    let names = (&model.capsules[pair.a].name, &model.capsules[pair.b].name);
    assert!(clearance_m > 0.05, "{clearance_m} m between {names:?}");
}
