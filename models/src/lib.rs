//! Sinew models.
