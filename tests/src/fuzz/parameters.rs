//! The readers of parameters: TOML files and the settings of `--set`.

use vgstereo_core::{Config, DisparityRange, Preset};
use vgstereo_sim::parameters::{to_toml, with_setting, with_toml};

use super::{NAME, accepted, within_memory};

/// Reads a text over each preset: lines that begin with `--set ` are settings, the others make up a
/// document. What is accepted and valid can be configured, and is read back from what is written.
pub fn run(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    let (settings, lines): (Vec<&str>, Vec<&str>) =
        text.lines().partition(|line| line.starts_with("--set "));
    let document = lines.join("\n");
    let bytes_max = (1 << 18) + 512 * bytes.len() as u64;
    for preset in Preset::ALL {
        let start = preset.parameters();
        let read = within_memory(bytes_max, || with_toml(&start, &document, NAME));
        let Some(mut parameters) = accepted(read, NAME) else {
            continue;
        };
        for setting in &settings {
            let setting = setting.trim_start_matches("--set ");
            let read = within_memory(bytes_max, || with_setting(&parameters, setting));
            if let Some(changed) = accepted(read, "--set") {
                parameters = changed;
            }
        }
        if parameters.validate().is_err() {
            continue;
        }
        let config = Config::new(parameters, 640, DisparityRange::up_to(47));
        assert_eq!(config.validate(), Ok(()), "{parameters:?}");
        let written = to_toml(&parameters).unwrap();
        for other in Preset::ALL {
            let read = with_toml(&other.parameters(), &written, NAME).unwrap();
            assert_eq!(read, parameters, "{preset} over {other}: {written}");
        }
    }
}
