//! What stands behind the doors: a simulation, and the hand that pulls.

use glam::Vec3;
use serde_json::{Value, json};
use sinew_embed::{
    DVec3, EmbedError, Embedding, Handle, InputError, Kind, Overrides, Pick, PullSpec, Result,
    YoungPoisson, solver_settings,
};
use sinew_render::colour::{BODY_COLOURS, WOUND_COLOURS, wound_shade};
use sinew_render::look::Look;
use sinew_render::rigid::Rigid;
use sinew_render::scene::Recording;
use sinew_render::skin::Skin;
use std::collections::HashMap;

/// Name of the hand among pulls.
const HAND: &str = "hand of the page";

/// What a page holds.
#[derive(Default)]
pub struct Page {
    room: Vec<u8>,
    files: HashMap<String, Vec<u8>>,
    simulation: Option<Embedding>,
    picked: Option<Pick>,
    hand: Option<Handle>,
    /// Size (m) of the scene, for the colours of wounds.
    size: f32,
}

fn invalid(what: &str, problem: &str) -> EmbedError {
    InputError::Invalid { what: what.into(), problem: problem.into() }.into()
}

fn json_of(value: Value) -> Vec<u8> {
    value.to_string().into_bytes()
}

impl Page {
    /// Room for so many bytes.
    pub fn room(&mut self, bytes: usize) -> &mut [u8] {
        self.room.clear();
        self.room.resize(bytes, 0);
        &mut self.room
    }

    fn text(&self, what: &str) -> Result<&str> {
        std::str::from_utf8(&self.room).map_err(|_| invalid(what, "it is not UTF-8"))
    }

    fn own(&mut self) -> Result<&mut Embedding> {
        self.simulation.as_mut().ok_or_else(|| invalid("simulation", "open a scene first"))
    }

    /// The simulation and a thing of it, by its place among those of its kind.
    fn one(&mut self, kind: Kind, index: u32) -> Result<(&mut Embedding, Handle)> {
        let own = self.own()?;
        let all = own.list(kind);
        let found = all.get(index as usize).map(|(handle, _)| *handle);
        let problem = || format!("{index} is none of the {} of the scene", all.len());
        let handle = found.ok_or_else(|| invalid(kind.name(), &problem()))?;
        Ok((own, handle))
    }

    fn body(&mut self, body: u32) -> Result<(&mut Embedding, Handle)> {
        self.one(Kind::Body, body)
    }

    pub fn file(&mut self) -> Result<Vec<u8>> {
        let end = self.room.iter().position(|byte| *byte == 0);
        let end = end.ok_or_else(|| invalid("file", "no zero byte ends its name"))?;
        let name = std::str::from_utf8(&self.room[..end]);
        let name = name.map_err(|_| invalid("name of a file", "it is not UTF-8"))?.to_string();
        self.files.insert(name, self.room[end + 1..].to_vec());
        Ok(Vec::new())
    }

    pub fn open(&mut self) -> Result<Vec<u8>> {
        (self.simulation, self.picked, self.hand) = (None, None, None);
        // a page has one thread, whatever the scene says
        let overrides = Overrides { threads: Some(1), ..Overrides::default() };
        let text = self.text("scene")?;
        let own = Embedding::from_scene(text, "scene.toml", self.files.clone(), &overrides)?;
        self.simulation = Some(own);
        Ok(Vec::new())
    }

    pub fn names(&mut self) -> Result<Vec<u8>> {
        let own = self.own()?;
        let named =
            |kind| -> Vec<String> { own.list(kind).into_iter().map(|(_, name)| name).collect() };
        let (constraints, tools, pulls) =
            (named(Kind::Constraint), named(Kind::Tool), named(Kind::Pull));
        let mut bodies = Vec::new();
        for (body, name) in own.list(Kind::Body) {
            let (material, _) = own.material(body)?;
            let mesh = own.mesh(body)?;
            let (vertices, tetrahedra) = (mesh.points.len(), mesh.tetrahedra.len());
            bodies.push(json!({
                "name": name,
                "vertices": vertices,
                "tetrahedra": tetrahedra,
                "young_modulus": material.young_modulus,
                "poisson_ratio": material.poisson_ratio,
                "density": material.density,
            }));
        }
        let solver = serde_json::to_value(own.solver()).unwrap_or_default();
        Ok(json_of(json!({
            "name": own.scene_name(), "bodies": bodies, "constraints": constraints, "tools": tools, "pulls": pulls,
            "dt": own.dt(), "gravity": own.gravity(), "solver": solver, "warnings": own.warnings(),
        })))
    }

    pub fn look(&mut self, radius: f64) -> Result<Vec<u8>> {
        let own = self.own()?;
        let mut rest = Vec::new();
        for (body, _) in own.list(Kind::Body) {
            let points = own.mesh(body)?.points.iter();
            rest.extend(points.map(|x| x.to_array().map(|x| x as f32)));
        }
        let radius = radius as f32;
        let ball = Rigid::rounded_box(Vec3::splat(radius), radius, [0; 3]);
        let drawn = Skin { points: (0..rest.len() as u32).collect(), ..Skin::default() };
        let at_rest =
            Recording { up: Vec3::Z, rest, rest_skin: drawn.into(), ..Recording::default() };
        let look = Look::of(&at_rest, None);
        self.size = at_rest.size();
        Ok(json_of(json!({
            "colours": BODY_COLOURS, "wound": WOUND_COLOURS, "size": self.size, "up": at_rest.up.to_array(),
            "middle": look.middle.to_array(), "floor": look.floor, "shade": look.shade, "grid": look.grid,
            "ball": { "points": ball.points, "normals": ball.normals, "triangles": ball.triangles },
        })))
    }

    pub fn step(&mut self, count: u32) -> Result<Vec<u8>> {
        self.own()?.step(count)?;
        Ok(Vec::new())
    }

    pub fn report(&mut self) -> Result<Vec<u8>> {
        let hand = self.hand;
        let own = self.own()?;
        let mut report = serde_json::to_value(own.report()).unwrap_or_default();
        let mut reactions = serde_json::Map::new();
        for (constraint, name) in own.list(Kind::Constraint) {
            reactions.insert(name, json!(own.reaction(constraint, [0.0; 3])?.force));
        }
        let mut tools = serde_json::Map::new();
        for (tool, name) in own.list(Kind::Tool) {
            tools.insert(name, json!(own.tool_report(tool)?.force.to_array()));
        }
        let mut revisions = Vec::new();
        for (body, _) in own.list(Kind::Body) {
            revisions.push(own.skin(body)?.revision);
        }
        report["reactions"] = reactions.into();
        report["tools"] = tools.into();
        report["revisions"] = revisions.into();
        report["verdict"] = json!(own.verdict());
        report["hand"] = match hand {
            None => Value::Null,
            Some(hand) => {
                let pull = own.pull_report(hand)?;
                json!({ "force": pull.force.to_array(), "distance": pull.distance, "work": pull.work })
            }
        };
        Ok(json_of(report))
    }

    pub fn hash(&mut self) -> Result<Vec<u8>> {
        Ok(format!("{:016x}", self.own()?.hash()).into_bytes())
    }

    pub fn points(&mut self, body: u32) -> Result<Vec<u8>> {
        let (own, body) = self.body(body)?;
        let points = own.skin(body)?.points;
        Ok(points.iter().flatten().flat_map(|x| (*x as f32).to_le_bytes()).collect())
    }

    pub fn surface(&mut self, body: u32) -> Result<Vec<u8>> {
        let size = self.size;
        let (own, body) = self.body(body)?;
        let skin = own.skin(body)?;
        let mut bytes = Vec::new();
        let counts = [skin.points.len() as u32, skin.triangles.len() as u32];
        let words = counts.iter().chain(skin.triangles.iter().flatten());
        words.for_each(|word| bytes.extend(word.to_le_bytes()));
        let mut shades = vec![0; skin.points.len()];
        for (triangle, _) in skin.triangles.iter().zip(skin.wound).filter(|(_, wound)| **wound) {
            for point in triangle.map(|point| point as usize) {
                let shade = wound_shade(skin.depth[point] as f32, size);
                shades[point] = 1 + (254.0 * shade).round() as u8;
            }
        }
        bytes.extend(shades);
        Ok(bytes)
    }

    pub fn pick(
        &mut self,
        x: f64,
        y: f64,
        z: f64,
        along_x: f64,
        along_y: f64,
        along_z: f64,
    ) -> Result<Vec<u8>> {
        let own = self.own()?;
        let picked = own.pick([x, y, z], [along_x, along_y, along_z])?;
        let bodies = own.list(Kind::Body);
        self.picked = picked;
        Ok(json_of(picked.map_or(Value::Null, |pick| {
            let body = bodies.iter().position(|(handle, _)| *handle == pick.body);
            json!({ "body": body, "vertices": pick.vertices, "weights": pick.weights, "position": pick.position,
                "distance": pick.distance })
        })))
    }

    pub fn pull(&mut self, stiffness: f64, damping: f64) -> Result<Vec<u8>> {
        let nothing = || invalid("hand", "no place was picked that it could take hold of");
        let pick = self.picked.ok_or_else(nothing)?;
        self.release()?;
        let hand = self.own()?.add_pull(
            pick.body,
            &PullSpec {
                name: HAND,
                vertices: &pick.vertices,
                weights: &pick.weights,
                stiffness,
                damping,
            },
        )?;
        self.hand = Some(hand);
        Ok(Vec::new())
    }

    pub fn move_hand(&mut self, x: f64, y: f64, z: f64) -> Result<Vec<u8>> {
        let hand = self.hand.ok_or_else(|| invalid("hand", "it holds nothing"))?;
        self.own()?.move_pull(hand, DVec3::new(x, y, z))?;
        Ok(Vec::new())
    }

    pub fn release(&mut self) -> Result<Vec<u8>> {
        if let Some(hand) = self.hand.take() {
            self.own()?.remove(hand)?;
        }
        Ok(Vec::new())
    }

    pub fn tool(&mut self, tool: u32, x: f64, y: f64, z: f64, jump: u32) -> Result<Vec<u8>> {
        let (own, tool) = self.one(Kind::Tool, tool)?;
        let place = DVec3::new(x, y, z);
        if jump == 1 {
            own.place_tool(tool, place)?
        } else {
            own.move_tool(tool, place)?
        }
        Ok(Vec::new())
    }

    pub fn cut(&mut self, body: u32) -> Result<Vec<u8>> {
        let numbers: Vec<f64> =
            self.room.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
        if !self.room.len().is_multiple_of(48) {
            return Err(invalid("blade", "it needs six numbers of 64 bits a position"));
        }
        let ends = numbers.as_chunks::<6>().0.iter();
        let strip: Vec<[DVec3; 2]> =
            ends.map(|&[a, b, c, x, y, z]| [DVec3::new(a, b, c), DVec3::new(x, y, z)]).collect();
        let (own, body) = self.body(body)?;
        let report = own.cut(body, &strip)?;
        Ok(json_of(json!({
            "separated": report.separated.len(), "vertices": report.vertices, "spare": report.spare,
            "pieces": report.pieces, "area": report.area,
        })))
    }

    pub fn material(
        &mut self,
        body: u32,
        young_modulus: f64,
        poisson_ratio: f64,
    ) -> Result<Vec<u8>> {
        let (own, body) = self.body(body)?;
        let (before, _) = own.material(body)?;
        let material = YoungPoisson { young_modulus, poisson_ratio, ..before };
        own.set_material(body, material.into())?;
        Ok(Vec::new())
    }

    pub fn set_dt(&mut self, dt: f64) -> Result<Vec<u8>> {
        self.own()?.set_dt(dt)?;
        Ok(Vec::new())
    }

    pub fn set_solver(&mut self) -> Result<Vec<u8>> {
        let settings = solver_settings(self.text("solver")?)?;
        self.own()?.set_solver(settings)?;
        Ok(Vec::new())
    }
}
