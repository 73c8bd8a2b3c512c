//! What is in doubt: where what is seen repeats, hardly anything is believed, and confidence tells what is
//! likely to be right.

use vgstereo_core::{Output, Preset};
use vgstereo_sim::arguments::aggregating_unless_named;
use vgstereo_sim::metrics::ByConfidence;
use vgstereo_sim::prepared::Prepared;
use vgstereo_sim::render::{RenderOptions, render};
use vgstereo_sim::scene::Scene;
use vgstereo_sim::stress::{Kind, Stress};
use vgstereo_tests::{Found, matched_with_and_without_doubt, with_sgm};

/// The built-in scene, in whose middle surfaces have stripes of this period, px; or as it is.
fn scene(period_px: Option<f32>) -> Prepared {
    let mut scene: Scene = render(&RenderOptions::default());
    if let Some(amount) = period_px {
        let kind = Kind::Periodic;
        Stress { kind, amount }.apply(&mut scene, 1).unwrap();
    }
    Prepared::new(scene, false).unwrap()
}

/// What a preset finds in a scene, and what it finds without its doubt of rivals.
fn found_with_and_without_doubt(prepared: &Prepared, preset: Preset) -> [Found; 2] {
    let matched = matched_with_and_without_doubt(prepared, preset);
    matched.map(|matched| Found::new(&matched, &prepared.scene, 1.0))
}

#[test]
fn of_what_repeats_hardly_anything_is_kept() {
    for period_px in [6.0, 8.0, 12.0] {
        let prepared = scene(Some(period_px));
        for preset in aggregating_unless_named(&[]) {
            let [found, found_without] = found_with_and_without_doubt(&prepared, preset);
            println!("{period_px} px, {preset}: {found:.2?}, without doubt {found_without:.2?}");
            assert!(found.wrong < 1.2 && found.right < 5.0);
            assert!(found_without.wrong > 2.5 * found.wrong.max(1.0));
        }
    }
}

/// Paths bring in what is known around stripes, where their costs count less and their edges are no outlines.
#[test]
fn of_what_repeats_more_is_right() {
    for period_px in [6.0, 8.0, 12.0] {
        let prepared = scene(Some(period_px));
        for preset in aggregating_unless_named(&[]) {
            let parameters = preset.parameters();
            let as_it_comes = with_sgm(parameters, |sgm| {
                if let Some(rivals) = &mut sgm.rivals {
                    (rivals.cost_shift, rivals.p2_min) = (0, 0);
                }
            });
            let [bad, bad_as_it_comes] = [parameters, as_it_comes].map(|parameters| {
                let matched = prepared.matched(parameters, Output::Dense, 2).unwrap();
                let bad = prepared.measure(&matched, 1.0, false).unwrap();
                bad.average().unwrap()
            });
            println!("{period_px} px, {preset}: {bad:.1} %, as it comes {bad_as_it_comes:.1} %");
            let most = if preset == Preset::Lite { 0.97 } else { 0.9 };
            assert!(bad < most * bad_as_it_comes);
        }
    }
}

/// The scene has walls and a floor of tiles, which repeat.
#[test]
fn little_is_lost_elsewhere() {
    let prepared = scene(None);
    for preset in aggregating_unless_named(&[]) {
        let [found, found_without] = found_with_and_without_doubt(&prepared, preset);
        println!("{preset}: {found:.2?}, without doubt {found_without:.2?}");
        assert!(found.right > 0.975 * found_without.right);
        assert!(found.wrong < found_without.wrong);
    }
}

#[test]
fn the_more_confident_the_more_are_right() {
    for preset in aggregating_unless_named(&[]) {
        let mut counts = ByConfidence::NONE;
        let prepared = scene(None);
        let matched = prepared
            .matched(preset.parameters(), Output::Dense, 2)
            .unwrap();
        let truth = prepared.scene.truth.as_ref().unwrap();
        counts.count(&matched.disparities_q4, &matched.confidences, truth, 1.0);
        let tenths = counts.tenths().unwrap();
        println!("{preset}: {tenths:.2?}");
        // Of the most confident hardly any are wrong, and what is left is chance.
        assert!(tenths.is_sorted_by(|a, b| a > b || *b < 0.3));
        assert!(tenths[0] > 20.0 * tenths[9]);
    }
}
