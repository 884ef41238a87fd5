//! The values of a pickle. They name each other by their places, so that deep or circular ones cost no stack.

/// The place of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Id(pub(super) usize);

/// A name of Python: a function or a class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Global<'a> {
    pub(super) module: &'a str,
    pub(super) name: &'a str,
}

/// A key and a value of a dictionary.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub(super) key: Id,
    pub(super) value: Id,
}

/// What Python would have called.
#[derive(Clone, Debug)]
pub(super) struct Call {
    pub(super) callee: Id,
    pub(super) arguments: Id,
    /// What the result would have been told afterwards.
    pub(super) state: Option<Id>,
}

/// A value.
#[derive(Clone, Debug)]
pub(super) enum Node<'a> {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Bytes(&'a [u8]),
    Text(&'a str),
    /// A list, a tuple or a set.
    Sequence(Vec<Id>),
    Dict(Vec<Pair>),
    Global(Global<'a>),
    Call(Call),
}

impl Node<'_> {
    /// What it is, for errors.
    pub(super) fn kind(&self) -> String {
        match self {
            Self::None => "None".to_owned(),
            Self::Bool(_) => "a truth value".to_owned(),
            Self::Int(value) => format!("the number {value}"),
            Self::Float(value) => format!("the number {value}"),
            Self::Bytes(bytes) => format!("{} bytes", bytes.len()),
            Self::Text(text) => format!("the text `{}`", text.chars().take(40).collect::<String>()),
            Self::Sequence(items) => format!("a sequence of {}", items.len()),
            Self::Dict(pairs) => format!("a dictionary of {}", pairs.len()),
            Self::Global(global) => format!("`{} {}`", global.module, global.name),
            Self::Call(_) => "an object".to_owned(),
        }
    }
}

/// All values of a pickle.
#[derive(Debug, Default)]
pub(super) struct Heap<'a> {
    pub(super) nodes: Vec<Node<'a>>,
    /// The value that the pickle is of.
    pub(super) root: Option<Id>,
}

impl<'a> Heap<'a> {
    pub(super) fn add(&mut self, node: Node<'a>) -> Id {
        self.nodes.push(node);
        Id(self.nodes.len() - 1)
    }

    /// The value at a place; `None` is one as well.
    pub(super) fn get(&self, id: Id) -> &Node<'a> {
        self.nodes.get(id.0).unwrap_or(&Node::None)
    }

    pub(super) fn sequence(&self, id: Id) -> Option<&[Id]> {
        if let Node::Sequence(items) = self.get(id) { Some(items) } else { None }
    }

    pub(super) fn call(&self, id: Id) -> Option<&Call> {
        if let Node::Call(call) = self.get(id) { Some(call) } else { None }
    }

    pub(super) fn global(&self, id: Id) -> Option<Global<'a>> {
        if let Node::Global(global) = self.get(id) { Some(*global) } else { None }
    }

    pub(super) fn text(&self, id: Id) -> Option<&'a str> {
        if let Node::Text(text) = self.get(id) { Some(text) } else { None }
    }

    pub(super) fn count(&self, id: Id) -> Option<usize> {
        if let Node::Int(value) = self.get(id) { usize::try_from(*value).ok() } else { None }
    }

    /// The value of a text key of a dictionary.
    pub(super) fn entry(&self, id: Id, key: &str) -> Option<Id> {
        let Node::Dict(pairs) = self.get(id) else { return None };
        pairs.iter().find(|pair| self.text(pair.key) == Some(key)).map(|pair| pair.value)
    }
}
