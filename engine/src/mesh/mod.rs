//! Plain mesh data, readers, writers, generators and the check.
