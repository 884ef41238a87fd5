//! Textured walls of houses: brick or plaster, rows of windows, shops and doors.

use glam::Vec3;

use super::{
    maths::{cell, hash, mix, smoothstep, unit},
    surface::{FacePoint, Surface, Texel, colour, openness_above_ground, rectangle},
    texture::{octaves, pulse, stripes, survives},
};

/// Width of window frames (metres).
const FRAME: f32 = 0.09;

/// Share of the height of a facade's top edge that stays without windows (metres).
const PARAPET: f32 = 0.7;

/// What a wall is made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Masonry {
    /// Courses of stones: length, height and joint width (metres).
    Bricks { length: f32, course: f32, joint: f32 },
    /// Smooth plaster with stains.
    Plaster,
    /// Large panels with open joints, by their height (metres).
    Panels { height: f32 },
}

/// How a house looks.
#[derive(Clone, Debug)]
pub(crate) struct Facade {
    pub(crate) masonry: Masonry,
    pub(crate) wall: Vec3,
    /// Frames, sills and string courses.
    pub(crate) trim: Vec3,
    /// Doors and the band above shop windows.
    pub(crate) accent: Vec3,
    /// Height of the ground floor and of each other floor (metres).
    pub(crate) ground_height: f32,
    pub(crate) floor_height: f32,
    /// Distance of the windows' axes (metres); adjusted so that a whole number fits.
    pub(crate) bay_width: f32,
    /// Window size as a share of bay width and floor height.
    pub(crate) window: (f32, f32),
    /// Whether the ground floor is a shop.
    pub(crate) shop: bool,
}

/// A bay of a floor, and the place in it.
struct Bay {
    column: i32,
    floor: i32,
    x: f32,
    y: f32,
    width: f32,
    height: f32,
}

impl Facade {
    /// What the wall does with light at a place.
    pub(crate) fn texel(&self, at: &Surface) -> Texel {
        let p = at.on_face();
        if at.face >= 4 {
            let tone = 1.0 + 0.4 * octaves(p.u, p.v, 2.0, 3, at.footprint, at.seed);
            return Texel::opaque(colour(0.45, 0.44, 0.43) * tone);
        }
        let bay = self.bay(&p);
        let base = Texel { openness: openness_above_ground(p.v), ..Texel::opaque(self.wall_colour(&p, at)) };
        let mut texel = if bay.floor < 0 {
            self.ground_floor(base, &bay, at)
        } else if p.v < p.height - PARAPET {
            let size = (self.window.0 * bay.width, self.window.1 * bay.height);
            self.window(base, &bay, size, 0.5 * (bay.height - size.1) + 0.1, at)
        } else {
            base
        };
        let string = pulse(p.v, self.ground_height - 0.12, self.ground_height + 0.12, at.footprint)
            + pulse(p.v, p.height - 0.35, p.height, at.footprint);
        texel = texel.under(Texel::opaque(self.trim), string.min(1.0));
        // Corners and the shadow under the cornice.
        let edge = p.u.min(p.width - p.u);
        texel.openness *= mix(0.8, 1.0, smoothstep(0.0, 0.4, edge));
        texel.openness *= 1.0 - 0.35 * pulse(p.v, p.height - 0.75, p.height - 0.35, at.footprint);
        texel
    }

    fn bay(&self, p: &FacePoint) -> Bay {
        let width = p.width / (p.width / self.bay_width).round().max(1.0);
        let column = cell(p.u / width);
        let x = p.u - column as f32 * width;
        if p.v < self.ground_height {
            return Bay { column, floor: -1, x, y: p.v, width, height: self.ground_height };
        }
        let rest = (p.height - PARAPET - self.ground_height).max(self.floor_height);
        let height = rest / (rest / self.floor_height).round().max(1.0);
        let floor = cell((p.v - self.ground_height) / height);
        Bay { column, floor, x, y: p.v - self.ground_height - floor as f32 * height, width, height }
    }

    fn wall_colour(&self, p: &FacePoint, at: &Surface) -> Vec3 {
        let w = at.footprint;
        let stain = 0.22 * octaves(p.u, 0.5 * p.v, 0.45, 3, w, at.seed ^ 0x51);
        let grit = octaves(p.u, p.v, 6.0, 3, w, at.seed ^ 0x52);
        match self.masonry {
            Masonry::Plaster => {
                let streaks = 0.16 * octaves(2.5 * p.u, 0.15 * p.v, 1.0, 2, w, at.seed ^ 0x53);
                self.wall * (1.0 + stain + 0.16 * grit + streaks)
            }
            Masonry::Bricks { length, course, joint } => {
                let row = cell(p.v / course);
                let shifted = p.u + if row % 2 == 0 { 0.0 } else { 0.5 * length };
                let tone = unit(hash(cell(shifted / length), row, at.seed)) - 0.5;
                let tone = 0.55 * tone * survives(0.7 / length, w);
                let gaps = stripes(p.v, course, joint, w).max(stripes(shifted, length, joint, w));
                let brick = self.wall * (1.0 + stain + 0.12 * grit + tone);
                brick.lerp(Vec3::splat(0.34) + 0.3 * self.wall, 0.6 * gaps)
            }
            Masonry::Panels { height } => {
                let gaps = stripes(p.v, height, 0.05, w).max(stripes(p.u, 2.4 * height, 0.05, w));
                let (i, j) = (cell(p.u / (2.4 * height)), cell(p.v / height));
                let tone = 0.25 * (unit(hash(i, j, at.seed)) - 0.5) * survives(0.5 / height, w);
                self.wall * (1.0 + 0.7 * stain + 0.1 * grit + tone) * (1.0 - 0.6 * gaps)
            }
        }
    }

    /// `base` with a window of `size` over it, `sill` above the floor, centred in its bay.
    fn window(&self, base: Texel, bay: &Bay, size: (f32, f32), sill: f32, at: &Surface) -> Texel {
        let (w, place) = (at.footprint, (bay.x, bay.y));
        let low = (0.5 * (bay.width - size.0), sill);
        let high = (low.0 + size.0, low.1 + size.1);
        let ledge = rectangle(place, (low.0 - 0.15, low.1 - 0.16), (high.0 + 0.15, low.1), w);
        let lintel = rectangle(place, (low.0 - 0.12, high.1), (high.0 + 0.12, high.1 + 0.18), w);
        let frame = rectangle(place, low, high, w);
        let inner = ((low.0 + FRAME, low.1 + FRAME), (high.0 - FRAME, high.1 - FRAME));
        let pane = rectangle(place, inner.0, inner.1, w);
        let middle = 0.5 * (low.0 + high.0);
        let bar = pulse(bay.x, middle - 0.5 * FRAME, middle + 0.5 * FRAME, w).max(pulse(
            bay.y,
            mix(low.1, high.1, 0.66) - 0.03,
            mix(low.1, high.1, 0.66) + 0.03,
            w,
        ));
        let glass = self.pane(bay, (bay.x - low.0) / size.0, (bay.y - low.1) / size.1, at);
        base.under(Texel::opaque(self.trim * 0.85), ledge.max(0.8 * lintel))
            .under(Texel { openness: 0.7, ..Texel::opaque(self.trim) }, frame)
            .under(glass, pane * (1.0 - bar))
    }

    /// The pane of a window at shares of its width and height: dark rooms, curtains, blinds, a reflection of the sky.
    fn pane(&self, bay: &Bay, x: f32, y: f32, at: &Surface) -> Texel {
        let bits = hash(bay.column, bay.floor, at.seed ^ 0xA1);
        let rng = |k: i32| unit(hash(k, bay.floor, bits));
        let w = at.footprint / bay.width;
        let sky = colour(0.50, 0.58, 0.68) * mix(0.25, 0.9, rng(1));
        let room = colour(0.13, 0.14, 0.16) * mix(0.6, 1.6, rng(2));
        let cloudy = octaves(x + rng(3) * 9.0, y, 1.3, 2, w, bits);
        let mut albedo = room.lerp(sky, smoothstep(0.1, 1.3, y + 0.5 * cloudy));
        let cloth = colour(0.80, 0.77, 0.70) * mix(0.5, 1.0, rng(4));
        if rng(5) < 0.45 {
            let side = mix(0.1, 0.35, rng(6));
            let folds = 1.0 + 0.25 * octaves(x * 14.0, 0.0, 1.0, 1, 14.0 * w, bits);
            let covered = 1.0 - pulse(x, side, 1.0 - side, w);
            albedo = albedo.lerp(cloth * folds, 0.8 * covered);
        } else if rng(5) < 0.7 {
            let bottom = mix(0.2, 0.85, rng(7));
            let slats = 1.0 - 0.25 * stripes(y, 0.06, 0.02, w);
            albedo = albedo.lerp(cloth * slats, pulse(y, bottom, 1.1, w));
        }
        let reveal = 1.0 - 0.55 * pulse(y, 0.88, 1.1, w);
        Texel { albedo: albedo * reveal, glass: 0.9, openness: 0.85 }
    }

    fn ground_floor(&self, base: Texel, bay: &Bay, at: &Surface) -> Texel {
        let w = at.footprint;
        let is_door = hash(bay.column, 77, at.seed).is_multiple_of(3);
        let plinth = Texel { albedo: base.albedo * 0.55, ..base };
        let base = base.under(plinth, pulse(bay.y, 0.0, 0.5, w));
        if is_door {
            return self.door(base, bay, at);
        }
        if !self.shop {
            let size = (self.window.0 * bay.width, self.window.1 * bay.height);
            return self.window(base, bay, size, 1.0, at);
        }
        let size = (0.84 * bay.width, 0.58 * bay.height);
        let shop = self.window(base, bay, size, 0.55, at);
        self.fascia(shop, bay, at)
    }

    fn door(&self, base: Texel, bay: &Bay, at: &Surface) -> Texel {
        let w = at.footprint;
        let (half, top) = ((0.3 * bay.width).min(0.62), 2.35_f32.min(0.8 * bay.height));
        let place = (bay.x - 0.5 * bay.width, bay.y);
        let surround = rectangle(place, (-half - 0.16, 0.0), (half + 0.16, top + 0.2), w);
        let leaf = rectangle(place, (-half, 0.12), (half, top), w);
        let panels = stripes(place.0 + half, half, 0.1, w).max(stripes(place.1, 0.7, 0.1, w));
        let paint = self.accent * (1.0 - 0.45 * panels);
        let light = rectangle(place, (-half + 0.1, top - 0.5), (half - 0.1, top - 0.08), w);
        let door = Texel { openness: 0.7, ..Texel::opaque(paint) };
        let glass = Texel { albedo: colour(0.2, 0.24, 0.28), glass: 0.9, openness: 0.7 };
        let texel = base.under(Texel::opaque(self.trim), surround).under(door, leaf).under(glass, light);
        if self.shop { self.fascia(texel, bay, at) } else { texel }
    }

    /// `base` with the coloured band and the lettering of a shop over it.
    fn fascia(&self, base: Texel, bay: &Bay, at: &Surface) -> Texel {
        let w = at.footprint;
        let (low, high) = (bay.height - 0.95, bay.height - 0.25);
        let u = bay.column as f32 * bay.width + bay.x;
        let letter = cell(u / 0.34);
        let bits = hash(letter, 5, at.seed);
        let written = !bits.is_multiple_of(5) && unit(hash(letter.div_euclid(9), 6, at.seed)) < 0.7;
        let stroke = octaves(u * 1.3, bay.y * 1.6, 3.2, 1, w, bits) > -0.12;
        let inside = rectangle((u - letter as f32 * 0.34, bay.y), (0.04, low + 0.16), (0.30, high - 0.14), w);
        let ink = if written && stroke { inside } else { 0.0 };
        let board = Texel::opaque(self.accent.lerp(Vec3::splat(0.85), ink));
        base.under(board, pulse(bay.y, low, high, w))
    }
}
