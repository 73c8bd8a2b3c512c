//! The parameters of every kernel, for macros that write methods of
//! [`Kernels`](vgstereo_core::kernel::Kernels).

/// Invokes the macro `$write` once for each named kernel, or for all kernels if none is named, with
/// `$how` (any tokens in braces), the kernel's name, its parameters and its arguments.
macro_rules! write_methods {
    ($write:ident $how:tt: $($kernel:ident),+ $(,)?) => {
        $(write_methods!(@ $kernel $write $how);)+
    };
    ($write:ident $how:tt) => {
        write_methods!($write $how: luma_row, channel_row, convert_row, smooth_row, pack_cells,
            recall_row, mask_block, cost_run, aggregate_paths, select_row, aggregate_row, arms_row,
            median9_row, weighted_median_row);
    };
    (@ luma_row $($to:tt)+) => {
        write_methods!(@@ luma_row $($to)+,
            format: vgstereo_core::kernel::PixelFormat, line: &[u8], grey: &mut [u8]);
    };
    (@ channel_row $($to:tt)+) => {
        write_methods!(@@ channel_row $($to)+,
            format: vgstereo_core::kernel::PixelFormat, line: &[u8], channel: usize,
            row: &mut [u8]);
    };
    (@ convert_row $($to:tt)+) => {
        write_methods!(@@ convert_row $($to)+,
            conversion: &vgstereo_core::kernel::LevelConversion, levels: &[u8], low: &mut [u8],
            high: &mut [u8]);
    };
    (@ smooth_row $($to:tt)+) => {
        write_methods!(@@ smooth_row $($to)+,
            rows: [&[u8]; 3], step_max: u8, smoothed: &mut [u8]);
    };
    (@ pack_cells $($to:tt)+) => {
        write_methods!(@@ pack_cells $($to)+,
            samples: &[&[u8]; vgstereo_core::kernel::CELLS_PER_BYTE + 1], packed: &mut [u8]);
    };
    (@ recall_row $($to:tt)+) => {
        write_methods!(@@ recall_row $($to)+,
            row: &vgstereo_core::kernel::RowRecall<'_>, distances: &mut [i16],
            candidates_px: &mut [i16]);
    };
    (@ mask_block $($to:tt)+) => {
        write_methods!(@@ mask_block $($to)+, block: &mut vgstereo_core::kernel::MaskBlock<'_>);
    };
    (@ cost_run $($to:tt)+) => {
        write_methods!(@@ cost_run $($to)+,
            run: &vgstereo_core::kernel::CostRun<'_>, costs: &mut [u8]);
    };
    (@ aggregate_paths $($to:tt)+) => {
        write_methods!(@@ aggregate_paths $($to)+,
            row: &mut vgstereo_core::kernel::AggregateRow<'_>);
    };
    (@ select_row $($to:tt)+) => {
        write_methods!(@@ select_row $($to)+, row: &mut vgstereo_core::kernel::AggregateRow<'_>);
    };
    (@ aggregate_row $($to:tt)+) => {
        write_methods!(@@ aggregate_row $($to)+,
            row: &mut vgstereo_core::kernel::AggregateRow<'_>);
    };
    (@ arms_row $($to:tt)+) => {
        write_methods!(@@ arms_row $($to)+,
            row: &vgstereo_core::kernel::ArmsRow<'_>, scratch: &mut [u8], arms: &mut [i16]);
    };
    (@ median9_row $($to:tt)+) => {
        write_methods!(@@ median9_row $($to)+, rows: [&[i16]; 3], output: &mut [i16]);
    };
    (@ weighted_median_row $($to:tt)+) => {
        write_methods!(@@ weighted_median_row $($to)+,
            row: &vgstereo_core::kernel::WeightedMedianRow<'_>, weights: &mut [u8],
            output: &mut [i16]);
    };
    (@@ $kernel:ident $write:ident $how:tt, $($argument:ident: $type:ty),+) => {
        $write!($how $kernel ($($argument: $type),+) ($($argument),+));
    };
}
