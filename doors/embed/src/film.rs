//! Recording, and the page that plays it.

use crate::embedding::Embedding;
use crate::error::{Code, EmbedError, InputError, Result};
use sinew_scene::picture::Recorder;
use sinew_scene::run::Observer;

impl Embedding {
    /// Records from now on what [`Embedding::page`] shows: the state as it is and after every so many steps, the forces of tools,
    /// pulls and what moves in every one. A recording on its way is dropped. One that goes on for long keeps every second frame.
    ///
    /// # Errors
    /// [`Code::Argument`] when `every` is 0 or there is no body.
    pub fn record(&mut self, every: u64) -> Result<()> {
        if every == 0 {
            return Err(InputError::invalid(
                "a recording",
                "it needs a step at least from frame to frame",
            )
            .into());
        }
        if self.built.bodies.is_empty() {
            return Err(InputError::invalid("a recording", "there is no body to be shown").into());
        }
        let mut recorder = Recorder::open(self.scene_name().unwrap_or("simulation"), every);
        recorder.built(&mut self.built);
        self.recorder = Some((recorder, every));
        Ok(())
    }

    /// Ends the recording. A page that plays it, one file for any browser; without a recording one of the present state.
    ///
    /// # Errors
    /// As [`Embedding::record`], and [`Code::Step`] where the state is not finite.
    pub fn page(&mut self) -> Result<String> {
        if self.recorder.is_none() {
            self.record(1)?;
        }
        let verdict = self.verdict();
        let Some((mut recorder, _)) = self.recorder.take() else { return Ok(String::new()) };
        recorder.last(&mut self.built);
        recorder.into_page(verdict).map_err(|e| EmbedError::new(Code::Step, e.to_string()))
    }

    /// Refuses bodies that a recording on its way would not show.
    pub(crate) fn shows_all(&self) -> Result<()> {
        match self.recorder {
            None => Ok(()),
            Some(_) => Err(InputError::invalid(
                "a body",
                "a recording is on its way and would not show it; end it by taking its page first",
            )
            .into()),
        }
    }

    /// After a step.
    pub(crate) fn recorded(&mut self) {
        let (done, time) = (self.steps_done(), self.time());
        if let Some((recorder, _)) = &mut self.recorder {
            recorder.step(done, time, &mut self.built);
        }
    }

    /// Begins a recording anew, after the state has gone back.
    pub(crate) fn record_anew(&mut self) -> Result<()> {
        match self.recorder {
            None => Ok(()),
            Some((_, every)) => self.record(every),
        }
    }
}
