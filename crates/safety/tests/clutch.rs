//! Tests the clutch: the robot stands while it is held, and comes slowly afterwards.

use crate::support::{Bench, ticks};
use messages::{Fault, Mode};
use safety::engage::Permit;

#[test]
fn f119_clutch_holds_for_as_long_as_it_is_held_and_the_robot_then_follows_slowly() {
    let sides: [fn(&mut Bench, bool); 2] =
        [|bench, held| bench.input.operator.clutch_level = held, |bench, held| bench.input.target.clutch = held];
    for side in sides {
        let mut bench = Bench::engaged();
        side(&mut bench, true);
        assert_eq!(bench.step().mode, Mode::Holding);
        bench.input.motion.at_rest = true;
        assert_eq!(bench.steps(ticks(60_000)).mode, Mode::Holding, "no timeout");
        side(&mut bench, false);
        let out = bench.step();
        assert_eq!((out.mode, out.permit), (Mode::Engaging, Permit::Follow { speed_scale: 0.05 }));

        // Another cause of the hold has its time, whatever the clutch.
        side(&mut bench, true);
        bench.input.target.input_fresh = false;
        bench.step();
        assert!(bench.until(Mode::Disengaged, ticks(6000)) <= ticks(5000) + 2);

        // A robot without an operator does not wait.
        let mut bench = Bench::engaged();
        side(&mut bench, true);
        bench.step();
        bench.input.motion.at_rest = true;
        bench.let_go();
        assert_eq!(bench.step().mode, Mode::Disengaged);
        bench.steps(ticks(1000));
        bench.press();
        let out = bench.step();
        assert!(out.refused && out.active.has(Fault::Clutch), "nobody engages under the clutch: {:?}", out.active);
        side(&mut bench, false);
        assert_eq!(bench.steps(ticks(1000)).mode, Mode::Disengaged, "the old press means nothing");
    }
}
