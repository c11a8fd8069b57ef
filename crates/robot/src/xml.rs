//! Elements of an XML text with their lines, as far as a URDF needs them.

use crate::error::RobotError;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Longest accepted text, bytes. A dual-arm robot with two hands has 0.2 MB.
pub(crate) const TEXT_BYTES_MAX: usize = 5 << 20;
/// Deepest nesting, because readers recurse. robot/link/visual/material/color and extensions of
/// simulators stay below 12.
const DEPTH_MAX: usize = 24;

/// An element: its name, its line, its attributes, and what it contains.
#[derive(Debug, Default)]
pub(crate) struct Element {
    pub(crate) name: String,
    pub(crate) line: usize,
    attributes: Vec<(String, String)>,
    pub(crate) children: Vec<Self>,
}

impl Element {
    /// Reads the text's root. Refuses huge or deep texts, document types and entities.
    pub(crate) fn parse(file: &str, text: &str) -> Result<Self, RobotError> {
        if text.len() > TEXT_BYTES_MAX {
            return Err(RobotError::TooLong { file: file.into(), bytes: text.len(), bound: TEXT_BYTES_MAX });
        }
        let mut reader = Reader::from_str(text);
        let (mut line, mut counted) = (1, 0);
        // A new element belongs to the last open one. The first open element stands for the document and is not in the text.
        let mut open = vec![Self::default()];
        loop {
            let event = reader.read_event();
            let at = (reader.buffer_position() as usize).min(text.len());
            let begin = line;
            line += text.as_bytes()[counted..at].iter().filter(|byte| **byte == b'\n').count();
            counted = at;
            let place = |line: usize| format!("{file}: line {line}");
            let forbidden = |construct: &str| RobotError::Forbidden { file: place(begin), construct: construct.into() };
            match event.map_err(|error| RobotError::Syntax { file: place(line), cause: error.to_string() })? {
                Event::DocType(_) => return Err(forbidden("a document type (DTD)")),
                Event::GeneralRef(_) => return Err(forbidden("an entity reference")),
                Event::Start(tag) => {
                    if open.len() > DEPTH_MAX {
                        let (key, count) = ("depth of nested elements".into(), open.len());
                        return Err(RobotError::TooMany { file: place(begin), key, count, bound: DEPTH_MAX });
                    }
                    open.push(Self::new(&tag, &place(begin), begin)?);
                }
                Event::Empty(tag) => add(&mut open, Self::new(&tag, &place(begin), begin)?),
                Event::End(_) => {
                    let done = open.pop().unwrap_or_default();
                    add(&mut open, done);
                }
                Event::Eof => break,
                Event::Text(_) | Event::CData(_) | Event::Comment(_) | Event::Decl(_) | Event::PI(_) => {}
            }
        }
        let whole = open.len() == 1;
        let mut roots = open.swap_remove(0).children.into_iter();
        let cause = if whole { "must have one root element, <robot>" } else { "ends inside an element" };
        let root = roots.next().filter(|_| whole && roots.next().is_none());
        root.ok_or_else(|| RobotError::Syntax { file: file.into(), cause: cause.into() })
    }

    fn new(tag: &BytesStart<'_>, place: &str, line: usize) -> Result<Self, RobotError> {
        let name = String::from_utf8_lossy(tag.name().as_ref()).into_owned();
        let syntax = |cause: String| RobotError::Syntax { file: place.into(), cause: format!("<{name}>: {cause}") };
        let mut attributes = Vec::new();
        for attribute in tag.attributes() {
            let attribute = attribute.map_err(|error| syntax(error.to_string()))?;
            let value = attribute.unescape_value().map_err(|error| syntax(error.to_string()))?;
            attributes.push((String::from_utf8_lossy(attribute.key.as_ref()).into_owned(), value.into_owned()));
        }
        Ok(Self { name, line, attributes, children: Vec::new() })
    }

    /// The attribute's value.
    pub(crate) fn attribute(&self, key: &str) -> Option<&str> {
        self.attributes.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }

    /// The children of a name.
    pub(crate) fn all<'e>(&'e self, name: &'e str) -> impl Iterator<Item = &'e Self> {
        self.children.iter().filter(move |child| child.name == name)
    }
}

fn add(open: &mut [Element], done: Element) {
    if let Some(parent) = open.last_mut() {
        parent.children.push(done);
    }
}
