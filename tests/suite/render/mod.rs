//! Properties of the renderer, of the twin and of the fast path alike.

mod chain_rule;
mod differences;
pub(crate) mod fast;
mod motion;
mod renderer;
mod rolling;
mod simple;

use libtest_mimic::Trial;
use renderer::Renderer;

pub(crate) fn cases() -> Vec<Trial> {
    let mut cases = Vec::new();
    for renderer in Renderer::ALL {
        cases.extend(differences::cases(renderer));
        cases.extend(motion::cases(renderer));
        cases.extend(simple::cases(renderer));
    }
    cases.extend(fast::cases());
    cases.extend(rolling::cases());
    cases.extend(chain_rule::cases());
    cases
}
