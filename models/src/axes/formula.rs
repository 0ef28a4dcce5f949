//! Formulas in `x`, `y` and `z`, as scene files give them for fibre fields.
//!
//! `+ - * /` from left to right, `^` from right to left and before a sign (`-x^2` is `-(x^2)`), parentheses,
//! `pi`, `tau`, `e` and the functions of [`FUNCTIONS`] and [`OF_TWO`]. Parsers that others keep bring regular
//! expressions (half a minute of compile time), another licence, or stand still; this is all they would be
//! used for.

/// Functions of one number; angles are in rad, `log` is the natural one. Those of `libm` give the same bits on every
/// machine.
const FUNCTIONS: [(&str, fn(f64) -> f64); 26] = [
    ("abs", f64::abs),
    ("signum", f64::signum),
    ("sin", libm::sin),
    ("cos", libm::cos),
    ("tan", libm::tan),
    ("asin", libm::asin),
    ("acos", libm::acos),
    ("atan", libm::atan),
    ("sinh", libm::sinh),
    ("cosh", libm::cosh),
    ("tanh", libm::tanh),
    ("asinh", libm::asinh),
    ("acosh", libm::acosh),
    ("atanh", libm::atanh),
    ("floor", f64::floor),
    ("round", f64::round),
    ("ceil", f64::ceil),
    ("trunc", f64::trunc),
    ("fract", f64::fract),
    ("exp", libm::exp),
    ("sqrt", f64::sqrt),
    ("cbrt", libm::cbrt),
    ("ln", libm::log),
    ("log", libm::log),
    ("log2", libm::log2),
    ("log10", libm::log10),
];
/// Functions of two numbers.
const OF_TWO: [(&str, fn(f64, f64) -> f64); 4] =
    [("atan2", libm::atan2), ("min", f64::min), ("max", f64::max), ("pow", libm::pow)];
/// Parentheses, signs and powers within each other; more would not be read by anyone.
const DEEPEST: usize = 64;

#[derive(Clone, Copy)]
enum Step {
    Number(f64),
    Axis(usize),
    Of(fn(f64) -> f64),
    OfTwo(fn(f64, f64) -> f64),
}

/// A formula that has been read.
pub(super) struct Formula {
    /// operands before what takes them
    steps: Vec<Step>,
}

impl Formula {
    /// Reads a formula; what is wrong with it otherwise.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let mut parser = Parser { rest: text.trim_start(), depth: 0, steps: Vec::new() };
        parser.sum()?;
        match parser.rest {
            "" => Ok(Self { steps: parser.steps }),
            rest => Err(format!("`{rest}` is left over")),
        }
    }

    /// Value at a point (m); not finite where the formula has none.
    pub(super) fn at(&self, point: [f64; 3]) -> f64 {
        let mut stack = Vec::with_capacity(self.steps.len());
        for step in &self.steps {
            let mut take = || stack.pop().unwrap_or(f64::NAN);
            let value = match *step {
                Step::Number(value) => value,
                Step::Axis(axis) => point[axis],
                Step::Of(function) => function(take()),
                Step::OfTwo(function) => {
                    let second = take();
                    function(take(), second)
                }
            };
            stack.push(value);
        }
        stack.pop().unwrap_or(f64::NAN)
    }
}

struct Parser<'a> {
    /// what has not been read, without leading blanks
    rest: &'a str,
    depth: usize,
    steps: Vec<Step>,
}

impl<'a> Parser<'a> {
    /// Takes the first `length` bytes.
    fn take(&mut self, length: usize) -> &'a str {
        let (taken, rest) = self.rest.split_at(length);
        self.rest = rest.trim_start();
        taken
    }

    /// Takes one of these characters if it comes next.
    fn one_of(&mut self, characters: &[char]) -> Option<char> {
        let next = self.rest.chars().next().filter(|c| characters.contains(c))?;
        self.take(next.len_utf8());
        Some(next)
    }

    fn expect(&mut self, character: char) -> Result<(), String> {
        match self.one_of(&[character]) {
            Some(_) => Ok(()),
            None => Err(format!("`{character}` is missing {}", self.here())),
        }
    }

    fn here(&self) -> String {
        match self.rest {
            "" => "at the end".to_string(),
            rest => format!("before `{rest}`"),
        }
    }

    fn sum(&mut self) -> Result<(), String> {
        self.product()?;
        while let Some(sign) = self.one_of(&['+', '-']) {
            self.product()?;
            self.steps.push(Step::OfTwo(if sign == '+' { |a, b| a + b } else { |a, b| a - b }));
        }
        Ok(())
    }

    fn product(&mut self) -> Result<(), String> {
        self.signed()?;
        while let Some(sign) = self.one_of(&['*', '/']) {
            self.signed()?;
            self.steps.push(Step::OfTwo(if sign == '*' { |a, b| a * b } else { |a, b| a / b }));
        }
        Ok(())
    }

    fn signed(&mut self) -> Result<(), String> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!(
                "more than {DEEPEST} parentheses, signs or powers within each other"
            ));
        }
        match self.one_of(&['+', '-']) {
            Some(sign) => {
                self.signed()?;
                self.steps.extend((sign == '-').then_some(Step::Of(|a| -a)));
            }
            None => {
                self.operand()?;
                if self.one_of(&['^']).is_some() {
                    self.signed()?;
                    self.steps.push(Step::OfTwo(libm::pow));
                }
            }
        }
        self.depth -= 1;
        Ok(())
    }

    fn operand(&mut self) -> Result<(), String> {
        if self.one_of(&['(']).is_some() {
            self.sum()?;
            return self.expect(')');
        }
        if self.rest.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
            let digits = |text: &str| {
                text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len())
            };
            let mut length = digits(self.rest);
            if let Some(power) = self.rest[length..].strip_prefix(['e', 'E']) {
                let figures = power.trim_start_matches(['+', '-']);
                length += 1 + power.len() - figures.len() + digits(figures);
            }
            let text = self.take(length);
            let value = text.parse().map_err(|_| format!("`{text}` is no number"))?;
            self.steps.push(Step::Number(value));
            return Ok(());
        }
        let word = |c: char| c.is_alphanumeric() || c == '_';
        if !self.rest.starts_with(word) {
            return Err(format!("a number, a variable or a function is missing {}", self.here()));
        }
        let name = self.take(self.rest.find(|c| !word(c)).unwrap_or(self.rest.len()));
        let step = match name {
            "x" => Step::Axis(0),
            "y" => Step::Axis(1),
            "z" => Step::Axis(2),
            "pi" | "PI" | "π" => Step::Number(std::f64::consts::PI),
            "tau" | "TAU" | "τ" => Step::Number(std::f64::consts::TAU),
            "e" | "E" => Step::Number(std::f64::consts::E),
            _ => self.call(name)?,
        };
        self.steps.push(step);
        Ok(())
    }

    /// A function and what it is taken of.
    fn call(&mut self, name: &str) -> Result<Step, String> {
        let one = FUNCTIONS.iter().find(|f| f.0 == name).map(|f| Step::Of(f.1));
        let two = OF_TWO.iter().find(|f| f.0 == name).map(|f| Step::OfTwo(f.1));
        let Some(step) = one.or(two) else {
            let names: Vec<&str> =
                FUNCTIONS.iter().map(|f| f.0).chain(OF_TWO.map(|f| f.0)).collect();
            let names = names.join(", ");
            return Err(format!(
                "`{name}` is none of the variables x, y, z and the functions {names}"
            ));
        };
        self.expect('(')?;
        self.sum()?;
        if two.is_some() {
            self.expect(',')?;
            self.sum()?;
        }
        self.expect(')')?;
        Ok(step)
    }
}
