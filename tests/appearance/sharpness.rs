//! How many pixels a processor draws, by the times that its pictures take.

use super::{played, shown};
use crate::browser::Browser;
use view::Server;

/// The share after each run of pictures, for runs of `[pictures, time of each in s]`.
fn shares(browser: &mut Browser, is_fixed: bool, runs: &[[f64; 2]]) -> Vec<f64> {
    let shares = browser.evaluate_async(&format!(
        "const {{ Sharpness }} = await import('/quality.js'), sharpness = new Sharpness({is_fixed}); \
         return {runs:?}.map(([count, time]) => {{ for (let n = 0; n < count; n += 1) sharpness.note(time); \
         return sharpness.share; }});"
    ));
    serde_json::from_value(shares).expect("numbers")
}

#[test]
fn sharpness_falls_at_once_and_rises_slowly_without_oscillation() {
    let (loaded, view) = (super::loaded(), shown());
    let server = Server::recording(played(&loaded, 1.0, 1.0), "played.mcap", &view, 0).expect("a port");
    let Some(mut browser) = Browser::open(server.address()) else { return };
    browser.wait("the page is there", "window.teleopd.drawn() > 0");
    let (slow, even, quick) = (1.0 / 20.0, 1.0 / 35.0, 1.0 / 60.0);
    assert_eq!(shares(&mut browser, true, &[[300.0, slow]]), [1.0], "a graphics card draws all");
    assert_eq!(
        shares(&mut browser, false, &[[15.0, slow], [3000.0, slow]]),
        [0.85, 0.5],
        "it falls, and not below a half"
    );
    assert_eq!(shares(&mut browser, false, &[[15.0, slow], [3000.0, even]]), [0.85, 0.85], "there is no room for more");
    let risen = shares(&mut browser, false, &[[15.0, slow], [299.0, quick], [1.0, quick], [900.0, quick]]);
    assert_eq!(risen, [0.85, 0.85, 1.0, 1.0], "it rises after 300 quick pictures, and not above all");
    // A rise that was taken back at once: the next one waits for 600 quick pictures, then for 1200.
    let back =
        [[15.0, slow], [300.0, quick], [15.0, slow], [599.0, quick], [1.0, quick], [15.0, slow], [1199.0, quick]];
    assert_eq!(shares(&mut browser, false, &back), [0.85, 1.0, 0.85, 0.85, 1.0, 0.85, 0.85]);
    // One that lasted is none that was taken back.
    let lasted = [[15.0, slow], [300.0, quick], [300.0, even], [15.0, slow], [300.0, quick]];
    assert_eq!(shares(&mut browser, false, &lasted), [0.85, 1.0, 1.0, 0.85, 1.0]);
}
