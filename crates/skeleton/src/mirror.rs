//! The image of a person in a mirror.

use messages::{LIMBS, SMPL_OTHER_SIDE, Skeleton, skeleton_flag};

/// Returns the person's image in a mirror at the plane y = 0 of the client's world. What the left side did, the right side
/// does. Limbs, hands and head turn as those of an image. The image of an image is the person again.
///
/// ```
/// use messages::{Layout, Limb, Skeleton, skeleton_flag};
///
/// let mut person = Skeleton { flags: skeleton_flag::LIMB[Limb::LeftUpper as usize], ..Skeleton::ZERO };
/// person.limbs[Limb::LeftUpper as usize] = [0.6, 0.0, 0.0, 0.8];
/// let image = skeleton::mirror_image(&person);
/// assert_eq!(image.flags, skeleton_flag::LIMB[Limb::RightUpper as usize] | skeleton_flag::IMAGE);
/// assert_eq!(image.limbs[Limb::RightUpper as usize], [-0.6, 0.0, 0.0, 0.8]);
/// assert_eq!(skeleton::mirror_image(&image), person);
/// ```
pub fn mirror_image(person: &Skeleton) -> Skeleton {
    let mut image = *person;
    for limb in 0..LIMBS {
        image.limbs[limb] = mirrored(person.limbs[(limb + 2) % LIMBS]);
    }
    image.hands = [mirrored(person.hands[1]), mirrored(person.hands[0])];
    image.closure = [person.closure[1], person.closure[0]];
    image.head = mirrored(person.head);
    image.positions = SMPL_OTHER_SIDE.map(|joint| {
        let [x, y, z] = person.positions[joint];
        [x, 0.0 - y, z]
    });
    let swapped = [
        (skeleton_flag::LIMB[0], skeleton_flag::LIMB[2]),
        (skeleton_flag::LIMB[1], skeleton_flag::LIMB[3]),
        (skeleton_flag::HAND[0], skeleton_flag::HAND[1]),
        (skeleton_flag::CLOSURE[0], skeleton_flag::CLOSURE[1]),
    ];
    for (left, right) in swapped {
        image.flags &= !(left | right);
        image.flags |= if person.flags & left != 0 { right } else { 0 };
        image.flags |= if person.flags & right != 0 { left } else { 0 };
    }
    image.flags ^= skeleton_flag::IMAGE;
    image
}

/// The mirror image of a rotation x y z w.
fn mirrored([x, y, z, w]: [f32; 4]) -> [f32; 4] {
    [0.0 - x, y, 0.0 - z, w]
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    #[test]
    fn hands_change_sides_and_head_turns_other_way() {
        let (hand, other, head) = ([0.5, 0.1, -0.2, 0.8], [-0.3, 0.4, 0.6, 0.1], [0.0, 0.2, 0.6, 0.7]);
        let flags = skeleton_flag::HAND[0] | skeleton_flag::HEAD | skeleton_flag::CLOSURE[0];
        let closure = [0.7, 0.0];
        let image = mirror_image(&Skeleton { hands: [hand, other], head, closure, flags, ..Skeleton::ZERO });
        assert_eq!(image.hands, [[0.3, 0.4, -0.6, 0.1], [-0.5, 0.1, 0.2, 0.8]]);
        assert_eq!(image.head, [0.0, 0.2, -0.6, 0.7]);
        assert_eq!(image.closure, [0.0, 0.7]);
        let flags = skeleton_flag::HAND[1] | skeleton_flag::HEAD | skeleton_flag::CLOSURE[1];
        assert_eq!(image.flags, flags | skeleton_flag::IMAGE);
    }
}
