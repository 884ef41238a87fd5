//! Choices that people name by a word.

/// A choice among a few values, each of which has a word.
pub trait Words: Copy + PartialEq + 'static {
    /// The word, the value and what it means, for help texts.
    const WORDS: &'static [(&'static str, Self, &'static str)];

    /// The word of the value.
    fn word(self) -> &'static str {
        Self::WORDS.iter().find(|(_, value, _)| *value == self).map_or("", |(word, ..)| word)
    }
}
