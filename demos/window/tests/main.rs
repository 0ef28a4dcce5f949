//! Windows. In one binary, as everywhere.

mod view;
