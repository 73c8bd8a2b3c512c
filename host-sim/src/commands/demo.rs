//! demo
use clap::Args;
/// Demo
#[derive(Debug, Args, Default)]
pub struct Demo {}
impl Demo {
    /// run
    pub fn run(self) -> anyhow::Result<String> {
        Ok(String::new())
    }
}
