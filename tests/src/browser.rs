//! A browser without a window that tests drive: Chromium, by its DevTools protocol.

use std::ffi::OsString;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::{Message, WebSocket};

/// Longest wait for an answer of the browser, and for what a page must come to.
const WAIT: Duration = Duration::from_secs(300);

/// A running browser. It ends when this is dropped.
#[derive(Debug)]
pub struct Browser {
    process: Child,
    socket: WebSocket<TcpStream>,
    requests: u64,
    _profile: TempDir,
}

/// An open page.
#[derive(Debug)]
pub struct Page<'b> {
    browser: &'b mut Browser,
    session: String,
    target: String,
}

/// The command that `CHROMIUM` names, or else `chromium`, if there is one.
#[must_use]
pub fn chromium() -> Option<OsString> {
    let name = std::env::var_os("CHROMIUM").unwrap_or_else(|| "chromium".into());
    let output = Command::new(&name).arg("--version").output().ok()?;
    output.status.success().then_some(name)
}

impl Browser {
    /// Starts a browser.
    ///
    /// # Errors
    /// Fails when it does not tell the address of its protocol.
    pub fn start(command: &OsString) -> Result<Self> {
        let profile = tempfile::tempdir()?;
        let mut process = Command::new(command)
            .args([
                "--headless",
                // Tests may run as root, which has no sandbox; the pages are our own.
                "--no-sandbox",
                "--enable-unsafe-swiftshader",
                "--remote-debugging-port=0",
                "--hide-scrollbars",
                "about:blank",
            ])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()?;
        let output = process.stderr.take().context("the browser says nothing")?;
        let mut lines = BufReader::new(output).lines().map_while(Result::ok);
        let address =
            lines.find_map(|line| line.split_once("listening on ").map(|(_, a)| a.to_owned()));
        let address = address.context("the browser told no address")?;
        thread::spawn(move || lines.for_each(drop));
        let host = address.trim_start_matches("ws://").split('/').next();
        let stream = TcpStream::connect(host.context("the browser told no host")?)?;
        stream.set_read_timeout(Some(WAIT))?;
        let (socket, _) = tungstenite::client(&address, stream)?;
        Ok(Self {
            process,
            socket,
            requests: 0,
            _profile: profile,
        })
    }

    /// Opens a page of this size, px.
    ///
    /// # Errors
    /// Fails when the browser refuses.
    pub fn open(&mut self, address: &str, [width, height]: [u32; 2]) -> Result<Page<'_>> {
        let made = self.call(None, "Target.createTarget", json!({ "url": "about:blank" }))?;
        let target = made["targetId"].as_str().context("no target")?.to_owned();
        let attach = json!({ "targetId": target, "flatten": true });
        let attached = self.call(None, "Target.attachToTarget", attach)?;
        let session = attached["sessionId"]
            .as_str()
            .context("no session")?
            .to_owned();
        let mut page = Page {
            browser: self,
            session,
            target,
        };
        let metrics = json!({
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false,
        });
        page.call("Emulation.setDeviceMetricsOverride", metrics)?;
        page.call("Page.navigate", json!({ "url": address }))?;
        Ok(page)
    }

    fn call(&mut self, session: Option<&str>, method: &str, parameters: Value) -> Result<Value> {
        self.requests += 1;
        let id = self.requests;
        let mut request = json!({ "id": id, "method": method, "params": parameters });
        if let Some(session) = session {
            request["sessionId"] = session.into();
        }
        self.socket.send(Message::text(request.to_string()))?;
        loop {
            let Message::Text(text) = self.socket.read()? else {
                continue;
            };
            let mut answer: Value = serde_json::from_str(&text)?;
            if answer["id"] == id {
                ensure!(answer["error"].is_null(), "{method}: {}", answer["error"]);
                return Ok(answer["result"].take());
            }
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Page<'_> {
    fn call(&mut self, method: &str, parameters: Value) -> Result<Value> {
        self.browser.call(Some(&self.session), method, parameters)
    }

    /// The value of an expression on the page.
    ///
    /// # Errors
    /// Fails when the expression throws.
    pub fn evaluate(&mut self, expression: &str) -> Result<Value> {
        let parameters = json!({
            "expression": expression, "returnByValue": true, "awaitPromise": true,
        });
        let mut answer = self.call("Runtime.evaluate", parameters)?;
        ensure!(
            answer["exceptionDetails"].is_null(),
            "{expression}: {}",
            answer["exceptionDetails"]
        );
        Ok(answer["result"]["value"].take())
    }

    /// Waits until an expression is true; while the page loads, it may throw.
    ///
    /// # Errors
    /// Fails when it does not become true in time.
    pub fn wait_until(&mut self, expression: &str) -> Result<()> {
        self.wait_long_until(expression, WAIT)
    }

    /// Waits as [`Page::wait_until`] does, for so long.
    ///
    /// # Errors
    /// Fails when it does not become true in time.
    pub fn wait_long_until(&mut self, expression: &str, longest: Duration) -> Result<()> {
        let started = Instant::now();
        while started.elapsed() < longest {
            if self.evaluate(expression).is_ok_and(|value| value == true) {
                return Ok(());
            }
            thread::sleep(Duration::from_millis(30));
        }
        let status = self.evaluate("JSON.stringify(window.vgstereo?.status)");
        bail!("{expression} does not become true; {status:?}")
    }

    /// Moves the mouse to a place on the page, px.
    ///
    /// # Errors
    /// Fails when the browser refuses.
    pub fn point_at(&mut self, x: f64, y: f64) -> Result<()> {
        let parameters = json!({ "type": "mouseMoved", "x": x, "y": y });
        self.call("Input.dispatchMouseEvent", parameters).map(drop)
    }

    /// Presses a key, by the name that scripts know it by.
    ///
    /// # Errors
    /// Fails when the browser refuses.
    pub fn press(&mut self, key: &str) -> Result<()> {
        for kind in ["keyDown", "keyUp"] {
            let parameters = json!({ "type": kind, "key": key });
            self.call("Input.dispatchKeyEvent", parameters)?;
        }
        Ok(())
    }

    /// Takes a picture of the page, a JPEG.
    ///
    /// # Errors
    /// Fails when the browser refuses.
    pub fn screenshot(&mut self) -> Result<Vec<u8>> {
        let shot = self.call(
            "Page.captureScreenshot",
            json!({ "format": "jpeg", "quality": 82 }),
        )?;
        let picture = shot["data"].as_str().context("no picture")?;
        Ok(BASE64_STANDARD.decode(picture)?)
    }
}

impl Drop for Page<'_> {
    fn drop(&mut self) {
        let target = json!({ "targetId": self.target });
        // The browser may have ended.
        let _ = self.browser.call(None, "Target.closeTarget", target);
    }
}
