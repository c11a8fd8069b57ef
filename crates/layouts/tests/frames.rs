//! A client that sends a layout in a frame other than the layout's.

use crate::client::{Turn, accept, as_smpl, axes, bent, judge, limbs_differ};
use crate::golden::{FLOAT_ERROR, clients};
use layouts::{Direction, Layouts};
use skeleton::DropReason;

/// All directions that three axes can have.
pub(crate) fn all_axes() -> Vec<[Direction; 3]> {
    let mut all = Vec::new();
    for x in Direction::ALL {
        for y in Direction::ALL {
            all.extend(Direction::ALL.map(|z| [x, y, z]));
        }
    }
    all.retain(|&directions| axes(directions).determinant().abs() > 0.5);
    assert_eq!(all.len(), 48);
    all
}

/// A turn about the vertical changes nothing, because limbs are relative to the chest. In all other frames the
/// person lies, stands on the head, or is a mirror image.
#[test]
fn f010_person_in_other_axes_is_refused_unless_turned_about_up() {
    let layouts = Layouts::default();
    for client in &mut clients() {
        let truth = judge(&as_smpl(&bent(), client.rotations)).expect("a person");
        let right = client.axes;
        let (mut turned, mut refused) = (0, 0);
        for directions in all_axes() {
            client.axes = axes(directions);
            // Our frame's up and handedness after the change.
            let ours: Turn = right.transpose() * client.axes;
            let kept = ours[(2, 2)] > 0.5 && ours.determinant() > 0.0;
            match accept(&layouts, &client.send(&bent(), Turn::identity())) {
                Ok(accepted) => {
                    assert!(kept, "layout {}: {directions:?} was taken", client.number);
                    assert!(limbs_differ(&accepted, &truth) < FLOAT_ERROR);
                    turned += 1;
                }
                Err(reason) => {
                    assert!(!kept, "layout {}: {directions:?} is dropped: {reason:?}", client.number);
                    assert!(matches!(reason, DropReason::NotUpright | DropReason::Chirality), "{reason:?}");
                    refused += 1;
                }
            }
        }
        assert_eq!((turned, refused), (4, 44), "layout {}", client.number);
    }
}

#[test]
fn f010_person_in_other_unit_is_refused() {
    for client in &mut clients() {
        let right = client.units_per_m;
        for factor in [1e-3, 1e-2, 1e-1, 10.0, 100.0, 1000.0] {
            client.units_per_m = right * factor;
            let reason = accept(&Layouts::default(), &client.send(&bent(), Turn::identity())).expect_err("no person");
            assert!(matches!(reason, DropReason::Size | DropReason::OutOfRange), "{factor}: {reason:?}");
        }
    }
}
