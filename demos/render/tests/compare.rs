//! Places of several runs in one picture.

use sinew_render::compare::{GridPlan, Layout};

#[test]
fn a_whole_picture_is_filled_by_its_panels() {
    for size in [[1280, 720], [720, 1280], [600, 338], [1920, 1080]] {
        for count in 1..=7 {
            for bar in [false, true] {
                let plan = GridPlan::new(Layout::Whole(size), count, bar);
                let [x, y] = plan.corner(count - 1);
                assert!(x + plan.panel[0] <= size[0] && y + plan.panel[1] <= size[1]);
                let inner = GridPlan::of_panels(plan.columns as usize, plan.panel, count, bar);
                for (inner, whole) in inner.whole.into_iter().zip(size) {
                    assert!(inner <= whole && inner + 2 * count as u32 > whole, "{plan:?}");
                }
            }
        }
    }
    let columns = |size, count| GridPlan::new(Layout::Whole(size), count, true).columns;
    assert_eq!(columns([1280, 720], 2), 2);
    assert_eq!(columns([1280, 720], 3), 3);
    assert_eq!(columns([720, 1280], 2), 1);
    assert_eq!(columns([1280, 720], 6), 3);
}
