//! Another user: a thread with other credentials. Linux keeps credentials per thread, and checks the thread's
//! file and socket access by them.

use rustix::process::geteuid;
use rustix::thread::{set_thread_groups, set_thread_res_gid, set_thread_res_uid};
use rustix::{process::Gid, process::Uid};

/// Returns true if this test can act as another user. Otherwise prints why not.
pub fn can_be_another() -> bool {
    let can = geteuid().is_root();
    if !can {
        println!("skipped: only root can act as another user");
    }
    can
}

/// Credentials of the acting user.
#[derive(Clone, Copy, Debug)]
pub struct User<'a> {
    /// User id.
    pub uid: u32,
    /// Group id.
    pub gid: u32,
    /// Supplementary groups.
    pub groups: &'a [u32],
}

impl User<'_> {
    /// Returns a user with this number. Its only group is one that no other user has.
    pub fn stranger(uid: u32) -> Self {
        Self { uid, gid: uid, groups: &[] }
    }

    /// Runs `work` as this user, on its own thread.
    pub fn does<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|scope| {
            let acting = scope.spawn(|| {
                let (uid, gid) = (Uid::from_raw(self.uid), Gid::from_raw(self.gid));
                let groups: Vec<_> = self.groups.iter().map(|&group| Gid::from_raw(group)).collect();
                set_thread_groups(&groups).expect("groups");
                set_thread_res_gid(gid, gid, gid).expect("a group");
                set_thread_res_uid(uid, uid, uid).expect("a user");
                work()
            });
            acting.join().expect("no panic")
        })
    }
}
