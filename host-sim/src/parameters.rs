//! Parameters in TOML: writing those of a preset, and replacing some of them.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use toml::{Table, Value};
use vgstereo_core::{Parameters, Preset};

use crate::escapes::shown;
use crate::files::read_text;

/// The value that leaves out an optional stage, in a file and on the command line.
const NONE: &str = "none";

/// Largest number of names in the key of a setting; parameters have three at most.
const NAMES_MAX: usize = 8;

/// Returns parameters as a TOML document, which [`with_file`] can read.
///
/// # Errors
/// No error is expected, since TOML can express all parameters.
pub fn to_toml(parameters: &Parameters) -> Result<String> {
    let mut table = Table::try_from(parameters)?;
    // Stages that are left out are written as such. Otherwise those of the preset that the
    // document is applied to would remain.
    if let Some(Value::Table(method)) = table.get_mut("method") {
        for preset in Preset::ALL {
            let mut other = Table::try_from(preset.parameters())?;
            if let Some(Value::Table(other)) = other.remove("method")
                && other.get("kind") == method.get("kind")
            {
                for (stage, _) in other {
                    method.entry(stage).or_insert(NONE.into());
                }
            }
        }
    }
    Ok(toml::to_string_pretty(&table)?)
}

/// Returns `parameters` after those in a TOML file have replaced them.
///
/// # Errors
/// Fails with one line that names the file and the reason.
pub fn with_file(parameters: &Parameters, path: &Path) -> Result<Parameters> {
    let text = read_text(path)?;
    with_toml(parameters, &text, &shown(path))
}

/// Returns `parameters` after those in the text of a TOML file have replaced them; `name` is for
/// messages.
///
/// # Errors
/// Fails with one line that gives name and reason.
pub fn with_toml(parameters: &Parameters, text: &str, name: &str) -> Result<Parameters> {
    let changes: Table = text
        .parse()
        .map_err(|error: toml::de::Error| anyhow!("{name}: {}", error.message()))?;
    let mut table = Table::try_from(parameters)?;
    merge(&mut table, changes);
    from_table(table).with_context(|| name.to_owned())
}

/// Returns `parameters` after one of them has been replaced. The setting is `key=value`, with
/// dots between the names in a key. The value is written as in TOML, or it is `none` to leave
/// out a stage.
///
/// # Errors
/// Fails with one line that names the setting and the reason.
pub fn with_setting(parameters: &Parameters, setting: &str) -> Result<Parameters> {
    let (key, value) = setting
        .split_once('=')
        .with_context(|| format!("--set {setting}: it must be KEY=VALUE"))?;
    let value: Value = match value.trim() {
        NONE => Value::String(NONE.to_owned()),
        value => value
            .parse()
            .map_err(|_| anyhow!("--set {setting}: the value is not a TOML value"))?,
    };
    ensure!(
        key.split('.').nth(NAMES_MAX).is_none(),
        "--set: a key has at most {NAMES_MAX} names"
    );
    let mut names = key.trim().split('.').rev();
    let last = names.next().unwrap_or_default();
    let mut changes = Table::from_iter([(last.to_owned(), value)]);
    for name in names {
        changes = Table::from_iter([(name.to_owned(), Value::Table(changes))]);
    }
    let mut table = Table::try_from(parameters)?;
    merge(&mut table, changes);
    from_table(table).with_context(|| format!("--set {setting}"))
}

fn from_table(table: Table) -> Result<Parameters> {
    match table.try_into() {
        Ok(parameters) => Ok(parameters),
        Err(error) => bail!("{}", error.message()),
    }
}

/// Replaces the values of `table` that `changes` names. A method of a different kind replaces
/// the whole method.
fn merge(table: &mut Table, changes: Table) {
    for (key, value) in changes {
        match (table.get_mut(&key), value) {
            (_, Value::String(none)) if none == NONE => {
                table.remove(&key);
            }
            (Some(Value::Table(own)), Value::Table(changes))
                if changes
                    .get("kind")
                    .is_none_or(|kind| own.get("kind") == Some(kind)) =>
            {
                merge(own, changes);
            }
            (_, Value::Table(whole)) => {
                let mut own = Table::new();
                merge(&mut own, whole);
                table.insert(key, own.into());
            }
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vgstereo_core::Method;

    #[test]
    fn every_preset_reads_back() {
        for preset in Preset::ALL {
            let parameters = preset.parameters();
            let text = to_toml(&parameters).unwrap();
            for other in Preset::ALL {
                let read = with_toml(&other.parameters(), &text, "p.toml").unwrap();
                assert_eq!(read, parameters, "{preset} over {other}");
            }
        }
    }

    #[test]
    fn stages_that_are_left_out_stay_out() {
        let mut parameters = Preset::Balanced.parameters();
        let Method::Sgm(sgm) = &mut parameters.method else {
            panic!("balanced aggregates");
        };
        (sgm.rivals, sgm.speckle, sgm.vote, sgm.weighted_median) = (None, None, None, None);
        let text = to_toml(&parameters).unwrap();
        for other in Preset::ALL {
            let read = with_toml(&other.parameters(), &text, "p.toml").unwrap();
            assert_eq!(read, parameters, "over {other}");
        }
    }

    #[test]
    fn settings_replace_one_parameter_each() {
        let micro = Preset::Micro.parameters();
        let set = |setting: &str| with_setting(&micro, setting);
        assert_eq!(set("synapses=128").unwrap().synapses, 128);
        assert_eq!(set("sigmas_px = [2.5, 1]").unwrap().sigmas_px, [2.5, 1.0]);
        let Method::Sgm(changed) = set("method.vote.reach_y_px=2").unwrap().method else {
            panic!("micro aggregates");
        };
        assert_eq!(changed.vote.unwrap().reach_y_px, 2);
        let Method::Sgm(changed) = set("method.vote=none").unwrap().method else {
            panic!("micro aggregates");
        };
        assert_eq!(changed.vote, None);
        let whole = "method.speckle={size_min=8,step_q4=32,reach_y_px=2}";
        let Method::Sgm(changed) = set(whole).unwrap().method else {
            panic!("micro aggregates");
        };
        assert_eq!(changed.speckle.unwrap().size_min, 8);
        // `lite` has no vote to take the rest from.
        let error = with_setting(&Preset::Lite.parameters(), "method.vote.reach_y_px=2");
        assert!(format!("{:#}", error.unwrap_err()).contains("reach_x_px"));
        for (setting, word) in [
            ("synapses", "KEY=VALUE"),
            ("synapses=many", "TOML"),
            ("synapses=-1", "synapses=-1"),
            ("synapse=64", "synapse"),
            ("method.p3=1", "p3"),
            ("method.p1=none", "p1"),
            // What follows the value is no part of it.
            ("method.p1=3\nsynapses=17", "not a TOML value"),
            ("method.p1=3\n[method]\np2=9", "not a TOML value"),
            ("method.p1=", "not a TOML value"),
            (&("a.".repeat(60_000) + "a=1"), "at most 8 names"),
        ] {
            let error = format!("{:#}", set(setting).unwrap_err());
            assert!(error.contains(word), "{setting}: {error}");
        }
    }
}
