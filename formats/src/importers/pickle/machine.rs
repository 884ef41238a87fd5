//! The stack machine of pickles, protocols 2 to 5, binary instructions only.
//!
//! # Source
//! `Lib/pickletools.py` of `CPython`, which documents every instruction.

use super::heap::{Call, Global, Heap, Id, Node, Pair};
use crate::{error::Result, importers::values::At};

/// Names that frames of pandas need besides the modules `pandas` and `numpy`.
const ALLOWED: [Global<'static>; 6] = [
    Global { module: "builtins", name: "slice" },
    Global { module: "builtins", name: "bytearray" },
    Global { module: "__builtin__", name: "slice" },
    Global { module: "functools", name: "partial" },
    Global { module: "_codecs", name: "encode" },
    Global { module: "collections", name: "OrderedDict" },
];

/// The values of a pickle.
///
/// # Errors
/// Bytes that are no pickle or end early, instructions that Python 3 does not write, names that no frame needs.
pub(super) fn run<'a>(at: At<'_>, bytes: &'a [u8]) -> Result<Heap<'a>> {
    let mut machine = Machine {
        at,
        rest: bytes,
        heap: Heap::default(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: Vec::new(),
        num_bytes: bytes.len(),
    };
    if bytes.first() != Some(&0x80) {
        return Err(at.error("a pickle of protocol 2 to 5", "other bytes"));
    }
    while !machine.step()? {}
    Ok(machine.heap)
}

struct Machine<'a, 'b> {
    at: At<'b>,
    /// What has not been read.
    rest: &'a [u8],
    heap: Heap<'a>,
    stack: Vec<Id>,
    /// Heights of the stack at which a collection starts.
    marks: Vec<usize>,
    memo: Vec<Option<Id>>,
    /// Bytes of the pickle: it remembers fewer values than that.
    num_bytes: usize,
}

impl<'a> Machine<'a, '_> {
    fn truncated<T>(&self) -> Result<T> {
        Err(self.at.error("more instructions", "the end of the file (truncated?)"))
    }

    fn damaged<T>(&self) -> Result<T> {
        Err(self.at.error("values for each instruction", "fewer (damaged?)"))
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8]> {
        let Some((head, rest)) = self.rest.split_at_checked(length) else { return self.truncated() };
        self.rest = rest;
        Ok(head)
    }

    /// A little-endian unsigned number of `size` bytes.
    fn number(&mut self, size: usize) -> Result<u64> {
        Ok(self.take(size)?.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte)))
    }

    /// What a length of `size` bytes stands before.
    fn block(&mut self, size: usize) -> Result<&'a [u8]> {
        let length = self.number(size)?;
        self.take(usize::try_from(length).unwrap_or(usize::MAX))
    }

    fn text(&mut self, size: usize) -> Result<Node<'a>> {
        let bytes = self.block(size)?;
        std::str::from_utf8(bytes).map(Node::Text).map_err(|e| self.at.error("UTF-8 text", e.to_string()))
    }

    fn line(&mut self) -> Result<&'a str> {
        let Some(end) = self.rest.iter().position(|&byte| byte == b'\n') else { return self.truncated() };
        let line = self.take(end)?;
        self.take(1)?;
        std::str::from_utf8(line).map_err(|e| self.at.error("UTF-8 text", e.to_string()))
    }

    fn push(&mut self, node: Node<'a>) {
        let id = self.heap.add(node);
        self.stack.push(id);
    }

    fn pop(&mut self) -> Result<Id> {
        let bottom = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= bottom {
            return self.damaged();
        }
        self.stack.pop().map_or_else(|| self.damaged(), Ok)
    }

    fn top(&self) -> Result<Id> {
        self.stack.last().copied().map_or_else(|| self.damaged(), Ok)
    }

    /// The values above the last mark.
    fn pop_mark(&mut self) -> Result<Vec<Id>> {
        match self.marks.pop() {
            Some(mark) if mark <= self.stack.len() => Ok(self.stack.split_off(mark)),
            _ => self.damaged(),
        }
    }

    fn pop_many(&mut self, count: usize) -> Result<Vec<Id>> {
        let mut items = (0..count).map(|_| self.pop()).collect::<Result<Vec<_>>>()?;
        items.reverse();
        Ok(items)
    }

    /// Runs one instruction; true for the last one.
    fn step(&mut self) -> Result<bool> {
        let instruction = self.take(1)?[0];
        match instruction {
            b'.' => {
                self.heap.root = Some(self.pop()?);
                return Ok(true);
            }
            0x80 => drop(self.take(1)?),
            0x95 => drop(self.take(8)?),
            b'(' => self.marks.push(self.stack.len()),
            b'0' => drop(self.pop()?),
            b'1' => drop(self.pop_mark()?),
            b'2' => self.stack.push(self.top()?),
            b'q' | b'r' | b'h' | b'j' | 0x94 => self.memory(instruction)?,
            b'c' | 0x93 => self.global(instruction)?,
            b'R' | 0x81 | 0x92 | b'b' => self.call(instruction)?,
            b'a' | b'e' | 0x90 | b's' | b'u' => self.fill(instruction)?,
            _ => self.value(instruction)?,
        }
        Ok(false)
    }

    /// Instructions that push a new value.
    fn value(&mut self, instruction: u8) -> Result<()> {
        let node = match instruction {
            b'N' => Node::None,
            0x88 => Node::Bool(true),
            0x89 => Node::Bool(false),
            b'J' => Node::Int(signed(self.take(4)?)),
            b'K' => Node::Int(i64::from(self.take(1)?[0])),
            b'M' => Node::Int(i64::from_le_bytes(widened(self.take(2)?, 0))),
            0x8a => self.long(1)?,
            0x8b => self.long(4)?,
            b'G' => Node::Float(f64::from_bits(self.number(8)?.swap_bytes())),
            b'C' | b'U' => Node::Bytes(self.block(1)?),
            b'B' | b'T' => Node::Bytes(self.block(4)?),
            0x8e | 0x96 => Node::Bytes(self.block(8)?),
            0x8c => self.text(1)?,
            b'X' => self.text(4)?,
            0x8d => self.text(8)?,
            b']' | b')' | 0x8f => Node::Sequence(Vec::new()),
            b'l' | b't' | 0x91 => Node::Sequence(self.pop_mark()?),
            0x85..=0x87 => Node::Sequence(self.pop_many(usize::from(instruction - 0x84))?),
            b'}' => Node::Dict(Vec::new()),
            b'd' => {
                let items = self.pop_mark()?;
                Node::Dict(self.pairs(&items)?)
            }
            other => {
                let found = format!("{other:#04x}, {} bytes before the end", self.rest.len() + 1);
                return Err(self.at.error("instructions of protocols 2 to 5", found));
            }
        };
        self.push(node);
        Ok(())
    }

    /// A signed number of at most 8 bytes.
    fn long(&mut self, size: usize) -> Result<Node<'a>> {
        let bytes = self.block(size)?;
        if bytes.len() > 8 {
            return Err(self.at.error("numbers of at most 8 bytes", format!("one of {}", bytes.len())));
        }
        Ok(Node::Int(signed(bytes)))
    }

    fn pairs(&self, items: &[Id]) -> Result<Vec<Pair>> {
        let (pairs, []) = items.as_chunks::<2>() else { return self.damaged() };
        Ok(pairs.iter().map(|&[key, value]| Pair { key, value }).collect())
    }

    /// Instructions that remember the top of the stack, and that bring it back.
    fn memory(&mut self, instruction: u8) -> Result<()> {
        let place = match instruction {
            b'q' | b'h' => self.number(1)?,
            b'r' | b'j' => self.number(4)?,
            _ => self.memo.len() as u64,
        };
        let place = usize::try_from(place).unwrap_or(usize::MAX);
        if matches!(instruction, b'h' | b'j') {
            let Some(id) = self.memo.get(place).copied().flatten() else { return self.damaged() };
            self.stack.push(id);
            return Ok(());
        }
        // Places are given out one after the other, each by an instruction.
        if place > self.num_bytes {
            return self.damaged();
        }
        let top = self.top()?;
        if place >= self.memo.len() {
            self.memo.resize(place + 1, None);
        }
        self.memo[place] = Some(top);
        Ok(())
    }

    /// Instructions that push a name of Python.
    fn global(&mut self, instruction: u8) -> Result<()> {
        let global = if instruction == b'c' {
            Global { module: self.line()?, name: self.line()? }
        } else {
            let (name, module) = (self.pop()?, self.pop()?);
            match (self.heap.text(module), self.heap.text(name)) {
                (Some(module), Some(name)) => Global { module, name },
                _ => return self.damaged(),
            }
        };
        let root = global.module.split('.').next().unwrap_or_default();
        if !ALLOWED.contains(&global) && !["pandas", "numpy"].contains(&root) {
            let found = format!("`{} {}`", global.module, global.name);
            return Err(self.at.error("only what frames of pandas need", found));
        }
        self.push(Node::Global(global));
        Ok(())
    }

    /// Instructions that would call something, or tell an object its state.
    fn call(&mut self, instruction: u8) -> Result<()> {
        let last = self.pop()?;
        if instruction == b'b' {
            let object = self.top()?;
            return match self.heap.nodes.get_mut(object.0) {
                Some(Node::Call(call)) => {
                    call.state = Some(last);
                    Ok(())
                }
                _ => self.damaged(),
            };
        }
        // The keyword arguments of 0x92 are of no use to frames.
        let arguments = if instruction == 0x92 { self.pop()? } else { last };
        let callee = self.pop()?;
        self.push(Node::Call(Call { callee, arguments, state: None }));
        Ok(())
    }

    /// Instructions that add to a list, a set or a dictionary.
    fn fill(&mut self, instruction: u8) -> Result<()> {
        let items = match instruction {
            b'a' => self.pop_many(1)?,
            b's' => self.pop_many(2)?,
            _ => self.pop_mark()?,
        };
        let pairs = matches!(instruction, b's' | b'u').then(|| self.pairs(&items)).transpose()?;
        let place = self.top()?.0;
        match (self.heap.nodes.get_mut(place), pairs) {
            (Some(Node::Sequence(list)), None) => list.extend(items),
            (Some(Node::Dict(dict)), Some(pairs)) => dict.extend(pairs),
            // An ordered dictionary is an object first; frames keep nothing in one.
            (Some(Node::Call(_)), _) => {}
            _ => return self.damaged(),
        }
        Ok(())
    }
}

/// The bytes and as many `fill` above them as make 8.
fn widened(bytes: &[u8], fill: u8) -> [u8; 8] {
    let mut wide = [fill; 8];
    let length = bytes.len().min(8);
    wide[..length].copy_from_slice(&bytes[..length]);
    wide
}

/// The little-endian signed number of at most 8 bytes.
fn signed(bytes: &[u8]) -> i64 {
    let negative = bytes.last().is_some_and(|&high| high >= 0x80);
    i64::from_le_bytes(widened(bytes, if negative { 0xff } else { 0 }))
}
