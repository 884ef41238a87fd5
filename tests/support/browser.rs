//! Pages in a headless Chromium, spoken to over its debugging pipe.

use std::env;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::Needed;

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];
/// Without these a browser looks for updates, accounts and a graphics card.
const FLAGS: &str = "--headless --no-sandbox --disable-quic --no-first-run --disable-background-networking \
    --disable-component-update --disable-sync --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist \
    --force-color-profile=srgb --window-size=1280,800 --remote-debugging-pipe";

/// Between two looks at whether a page is there, and how many before it is given up.
const WAIT: Duration = Duration::from_millis(50);
const MOST_WAITS: usize = 1200;

/// Whether there is a browser.
pub fn needed() -> Needed {
    if executable().is_some() { Needed::Here } else { Needed::Missing("a Chromium browser".to_owned()) }
}

fn executable() -> Option<PathBuf> {
    let places = env::var_os("PATH")?;
    let mut candidates = env::split_paths(&places).flat_map(|place| NAMES.map(|name| place.join(name)));
    candidates.find(|path| path.is_file())
}

/// One page in a browser of its own, which ends with it.
#[derive(Debug)]
pub struct Page {
    browser: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    session: Option<String>,
    last: u64,
    _profile: TempDir,
}

impl Page {
    /// The page of a file; `fragment` is what stands behind the `#`.
    ///
    /// # Errors
    /// There is no browser, or it does not answer.
    pub fn open(file: &Path, fragment: &str) -> Result<Self, String> {
        let executable = executable().ok_or("no browser in PATH")?;
        let profile = tempfile::tempdir().map_err(|e| e.to_string())?;
        // the browser reads commands from descriptor 3 and answers on 4
        let line =
            format!("exec \"$0\" {FLAGS} \"--user-data-dir=$1\" about:blank 3<&0 4>&1 </dev/null >/dev/null 2>&1");
        let mut command = Command::new("sh");
        command.arg("-c").arg(line).arg(executable).arg(profile.path());
        let spawned = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let mut browser = spawned.map_err(|e| format!("browser: {e}"))?;
        let (to, from) = (browser.stdin.take(), browser.stdout.take());
        let (Some(to), Some(from)) = (to, from) else { return Err("the browser has no pipes".to_owned()) };
        let from = BufReader::new(from);
        let mut page = Self { browser, to, from, session: None, last: 0, _profile: profile };
        let url = format!("file://{}#{fragment}", file.display());
        let target = page.call("Target.createTarget", &json!({ "url": url }))?["targetId"].clone();
        let attached = page.call("Target.attachToTarget", &json!({ "targetId": target, "flatten": true }))?;
        page.session = attached["sessionId"].as_str().map(str::to_owned);
        // until the empty page that a target begins with has given way, what is asked of it may go down with it
        for _ in 0..MOST_WAITS {
            match page.value("location.protocol + document.readyState") {
                Ok(state) if state == "file:complete" => return Ok(page),
                _ => std::thread::sleep(WAIT),
            }
        }
        Err(format!("{url}: not loaded after {MOST_WAITS} waits of {WAIT:?}"))
    }

    /// What a JavaScript expression, or the promise that it is, comes to.
    ///
    /// # Errors
    /// It throws; the text says what.
    pub fn value(&mut self, expression: &str) -> Result<Value, String> {
        let parameters = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let answer = self.call("Runtime.evaluate", &parameters)?;
        match answer.get("exceptionDetails") {
            Some(thrown) => Err(format!("{expression}: {thrown}")),
            None => Ok(answer["result"]["value"].clone()),
        }
    }

    fn call(&mut self, method: &str, parameters: &Value) -> Result<Value, String> {
        self.last += 1;
        let mut message = json!({ "id": self.last, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        let failed = |e: std::io::Error| format!("browser, {method}: {e}");
        self.to.write_all(format!("{message}\0").as_bytes()).map_err(failed)?;
        self.to.flush().map_err(failed)?;
        loop {
            let mut bytes = Vec::new();
            self.from.read_until(0, &mut bytes).map_err(failed)?;
            let Some((_, text)) = bytes.split_last() else { return Err(format!("{method}: the browser ended")) };
            let answer: Value = serde_json::from_slice(text).map_err(|e| format!("{method}: {e}"))?;
            if answer["id"] == json!(self.last) {
                return match answer.get("error") {
                    Some(error) => Err(format!("{method}: {error}")),
                    None => Ok(answer["result"].clone()),
                };
            }
        }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        // it may have ended by itself
        let _ = self.browser.kill();
        let _ = self.browser.wait();
    }
}
