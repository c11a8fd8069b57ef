//! How many pixels a processor draws, by the times that its pictures take.

use crate::browser::Browser;

/// The share after each run of pictures, for runs of `[pictures, time of each in s]`.
fn shares(browser: &mut Browser, is_fixed: bool, runs: &[[f64; 2]]) -> Vec<f64> {
    let shares = browser.evaluate_async(&format!(
        "const {{ Sharpness }} = await import('/quality.js'), sharpness = new Sharpness({is_fixed}); \
         return {runs:?}.map(([count, time]) => {{ for (let n = 0; n < count; n += 1) sharpness.note(time); \
         return sharpness.share; }});"
    ));
    serde_json::from_value(shares).expect("numbers")
}

/// It falls at once, and rises slowly without oscillation.
pub fn check(browser: &mut Browser) {
    let (slow, even, quick) = (1.0 / 20.0, 1.0 / 35.0, 1.0 / 60.0);
    assert_eq!(shares(browser, true, &[[300.0, slow]]), [1.0], "a graphics card draws all");
    assert_eq!(shares(browser, false, &[[15.0, slow], [3000.0, slow]]), [0.85, 0.5], "it falls, and not below a half");
    assert_eq!(shares(browser, false, &[[15.0, slow], [3000.0, even]]), [0.85, 0.85], "there is no room for more");
    let risen = shares(browser, false, &[[15.0, slow], [299.0, quick], [1.0, quick], [900.0, quick]]);
    assert_eq!(risen, [0.85, 0.85, 1.0, 1.0], "it rises after 300 quick pictures, and not above all");
    // A rise that was taken back at once: the next one waits for 600 quick pictures, then for 1200.
    let back =
        [[15.0, slow], [300.0, quick], [15.0, slow], [599.0, quick], [1.0, quick], [15.0, slow], [1199.0, quick]];
    assert_eq!(shares(browser, false, &back), [0.85, 1.0, 0.85, 0.85, 1.0, 0.85, 0.85]);
    // One that lasted is none that was taken back.
    let lasted = [[15.0, slow], [300.0, quick], [300.0, even], [15.0, slow], [300.0, quick]];
    assert_eq!(shares(browser, false, &lasted), [0.85, 1.0, 1.0, 0.85, 1.0]);
}
