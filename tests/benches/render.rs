//! Times of the renderer.

fn main() {
    divan::main();
}
