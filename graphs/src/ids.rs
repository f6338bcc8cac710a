//! Typed indices, so that the index of a node cannot be used as that of a stage run.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Declares an index type: it indexes lists and slices, and is displayed as a number.
#[macro_export]
macro_rules! index_type {
    ($(#[$attribute:meta])* $visibility:vis struct $name:ident;) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        $visibility struct $name(
            /// The index as a number.
            pub usize,
        );

        impl $name {
            /// All indices of a list of `count` items.
            $visibility fn all(count: usize) -> impl DoubleEndedIterator<Item = Self> + ExactSizeIterator + Clone {
                (0..count).map(Self)
            }

            /// Items with their indices.
            $visibility fn enumerate<T>(items: impl IntoIterator<Item = T>) -> impl Iterator<Item = (Self, T)> {
                items.into_iter().enumerate().map(|(index, item)| (Self(index), item))
            }
        }

        impl ::std::fmt::Debug for $name {
            fn fmt(&self, f: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                ::std::fmt::Debug::fmt(&self.0, f)
            }
        }

        impl ::std::fmt::Display for $name {
            fn fmt(&self, f: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                ::std::fmt::Display::fmt(&self.0, f)
            }
        }

        $crate::index_type!(@indexes [T], $name);
        $crate::index_type!(@indexes Vec<T>, $name);
    };
    (@indexes $list:ty, $name:ident) => {
        impl<T> ::std::ops::Index<$name> for $list {
            type Output = T;

            fn index(&self, index: $name) -> &T {
                &self[index.0]
            }
        }

        impl<T> ::std::ops::IndexMut<$name> for $list {
            fn index_mut(&mut self, index: $name) -> &mut T {
                &mut self[index.0]
            }
        }
    };
}

index_type! {
    /// Index of a stage run: among the runs of a plan.
    #[derive(Deserialize, JsonSchema, Serialize)]
    #[serde(transparent)]
    pub struct RunId;
}

index_type! {
    /// Index of a node: among the nodes of a stage run.
    #[derive(Deserialize, JsonSchema, Serialize)]
    #[serde(transparent)]
    pub struct NodeId;
}

index_type! {
    /// Index of an output port: among the outputs of a node, or of a source.
    #[derive(Deserialize, JsonSchema, Serialize)]
    #[serde(transparent)]
    pub struct PortId;
}

index_type! {
    /// Index of a variant: among the variants of a plan.
    #[derive(Deserialize, JsonSchema, Serialize)]
    #[serde(transparent)]
    pub struct VariantId;
}

index_type! {
    /// Index of a part: among those in which a sink takes the values of a frame.
    pub struct PartId;
}

index_type! {
    /// Index of a frame: its position among the frames of a source or a stage run, from 0.
    ///
    /// It is not the number that the source has for the frame, [`Frame::index`](crate::Frame::index).
    #[derive(Deserialize, JsonSchema, Serialize)]
    #[serde(transparent)]
    pub struct FrameIndex;
}

/// A node of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeRef {
    /// Its stage run.
    pub run: RunId,
    /// Its index there.
    pub node: NodeId,
}
