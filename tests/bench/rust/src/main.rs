// SPDX-License-Identifier: MIT
//! Filters of crates.io on the scenes of unscented.c: difference from Meshkal and ns a step (medians). Usage: unscented FOLDER, which has unscented-SCENE.txt.
//! Lines: scene, states, filter, real, crate, ns, difference. Exit status 1 if an extended filter differs by more than 1e-9 standard deviations.
//! Both crates use the propagated sigma points for the update and draw no new ones: their unscented filters neglect Q there and so differ.

use kalman_filters::builders::UnscentedKalmanFilterBuilder;
use kalman_filters::{JacobianStrategy, NonlinearSystem};
use minikalman::prelude::*;
use std::{env, fs, process, time::Instant};

const STEPS: usize = 64;
const ROWS: usize = 3;
const BATCHES: usize = 201;

struct Scene {
    name: &'static str,
    n: usize,
    bearings: bool,
    dt: f64,
    variance: f64,
    position: Vec<f64>,
    x0: Vec<f64>,
    p0: Vec<f64>,
    q: Vec<f64>,
    z: Vec<f64>,
    meshkal: Vec<Vec<(Vec<f64>, Vec<f64>)>>, // UKF, UKF scaled, EKF: x and P of each step
}

fn full(packed: &[f64], n: usize) -> Vec<f64> {
    (0..n * n).map(|k| (k / n, k % n)).map(|(i, j)| packed[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)]).collect()
}

fn read(folder: &str, name: &'static str) -> Scene {
    let path = format!("{folder}/unscented-{name}.txt");
    let text = fs::read_to_string(&path).unwrap_or_else(|e| {
        eprintln!("unscented: {path}: {e}");
        process::exit(2)
    });
    let mut numbers = text.split_whitespace().map(|w| w.parse::<f64>().expect("a number"));
    let mut take = |count: usize| -> Vec<f64> { (0..count).map(|_| numbers.next().expect("more numbers")).collect() };
    let head = take(4);
    let n = head[0] as usize;
    let half = n * (n + 1) / 2;
    Scene {
        name, n, bearings: head[1] != 0.0, dt: head[2], variance: head[3],
        position: take(3 * ROWS),
        x0: take(n),
        p0: full(&take(half), n),
        q: full(&take(half), n),
        z: take(STEPS * ROWS),
        meshkal: (0..3).map(|_| (0..STEPS).map(|_| { let x = take(n); (x, full(&take(half), n)) }).collect()).collect(),
    }
}

impl Scene {
    #[inline]
    fn h(&self, r: usize, x: impl Fn(usize) -> f64) -> f64 {
        let d = |axis: usize| x(2 * axis) - self.position[3 * r + axis];
        if self.bearings { d(1).atan2(d(0)) } else { (0..self.n / 2).map(|axis| d(axis) * d(axis)).sum::<f64>().sqrt() }
    }

    #[inline]
    fn jacobian(&self, r: usize, j: usize, x: impl Fn(usize) -> f64) -> f64 {
        if j % 2 == 1 { return 0.0; }
        let d = |axis: usize| x(2 * axis) - self.position[3 * r + axis];
        let square = (0..self.n / 2).map(|axis| d(axis) * d(axis)).sum::<f64>();
        if self.bearings { if j == 0 { -d(1) / square } else { d(0) / square } } else { d(j / 2) / square.sqrt() }
    }
}

/// Largest difference in standard deviations and their products.
fn difference(ours: &(Vec<f64>, Vec<f64>), x: &[f64], p: &[f64]) -> f64 {
    let n = x.len();
    let sigma: Vec<f64> = (0..n).map(|i| ours.1[i * n + i].sqrt()).collect();
    let of_x = (0..n).map(|i| (x[i] - ours.0[i]).abs() / sigma[i]);
    let of_p = (0..n * n).map(|k| (p[k] - ours.1[k]).abs() / (sigma[k / n] * sigma[k % n]));
    of_x.chain(of_p).fold(0.0, |most, d| if d <= most { most } else { d })
}

/// A pass calls its argument with each step's estimate and covariance, if it is asked to.
fn measure(scene: &Scene, filter: usize, title: &str, mut pass: impl FnMut(&mut Option<&mut dyn FnMut(usize, &[f64], &[f64])>)) -> bool {
    let mut most: f64 = 0.0;
    let mut look = |t: usize, x: &[f64], p: &[f64]| most = most.max(difference(&scene.meshkal[filter][t], x, p));
    pass(&mut Some(&mut look));
    let mut times: Vec<f64> = (0..BATCHES)
        .map(|_| {
            let begin = Instant::now();
            pass(&mut None);
            begin.elapsed().as_nanos() as f64 / STEPS as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let name = ["UKF", "UKF scaled", "EKF"][filter];
    println!("{}|{}|{}|64|{}|{:.0}|{:.1e}", scene.name, scene.n, name, title, times[BATCHES / 2], most);
    if filter == 2 && !(most <= 1e-9) {
        eprintln!("unscented: {}, {}: {} differs from Meshkal by {:.2e} standard deviations", scene.name, name, title, most);
        return false;
    }
    true
}

struct Model<'a>(&'a Scene);

impl NonlinearSystem<f64> for Model<'_> {
    fn state_transition(&self, x: &[f64], _: Option<&[f64]>, dt: f64) -> Vec<f64> {
        (0..self.0.n).map(|i| if i % 2 == 0 { x[i] + dt * x[i + 1] } else { x[i] }).collect()
    }
    fn measurement(&self, x: &[f64]) -> Vec<f64> {
        (0..ROWS).map(|r| self.0.h(r, |i| x[i])).collect()
    }
    fn state_jacobian(&self, _: &[f64], _: Option<&[f64]>, dt: f64) -> Vec<f64> {
        let n = self.0.n;
        (0..n * n).map(|k| if k / n == k % n { 1.0 } else if k / n % 2 == 0 && k % n == k / n + 1 { dt } else { 0.0 }).collect()
    }
    fn measurement_jacobian(&self, x: &[f64]) -> Vec<f64> {
        (0..ROWS * self.0.n).map(|k| self.0.jacobian(k / self.0.n, k % self.0.n, |i| x[i])).collect()
    }
    fn state_dim(&self) -> usize { self.0.n }
    fn measurement_dim(&self) -> usize { ROWS }
}

fn kalman_filters(scene: &Scene) -> bool {
    let r: Vec<f64> = (0..ROWS * ROWS).map(|k| if k / ROWS == k % ROWS { scene.variance } else { 0.0 }).collect();
    let start = || {
        UnscentedKalmanFilterBuilder::new(Model(scene))
            .initial_state(scene.x0.clone()).initial_covariance(scene.p0.clone()).process_noise(scene.q.clone()).measurement_noise(r.clone())
            .dt(scene.dt).alpha(1.0).beta(0.0).kappa(3.0 - scene.n as f64).build().expect("UKF")
    };
    let unscented = measure(scene, 0, "kalman_filters", |look| {
        let mut f = start();
        for t in 0..STEPS {
            f.predict().expect("predict");
            f.update(&scene.z[ROWS * t..ROWS * (t + 1)]).expect("update");
            if let Some(look) = look { look(t, f.state(), f.covariance()) }
        }
    });
    let start = || {
        kalman_filters::builders::ExtendedKalmanFilterBuilder::new(Model(scene))
            .initial_state(scene.x0.clone()).initial_covariance(scene.p0.clone()).process_noise(scene.q.clone()).measurement_noise(r.clone())
            .dt(scene.dt).jacobian_strategy(JacobianStrategy::Analytical).build().expect("EKF")
    };
    measure(scene, 2, "kalman_filters", |look| {
        let mut f = start();
        for t in 0..STEPS {
            f.predict();
            f.update(&scene.z[ROWS * t..ROWS * (t + 1)]).expect("update");
            if let Some(look) = look { look(t, f.state(), f.covariance()) }
        }
    }) && unscented
}

fn minikalman<const N: usize, const SIGMA: usize>(scene: &Scene) -> bool {
    let unscented = measure(scene, 0, "minikalman", |look| {
        let builder = minikalman::unscented::builder::KalmanFilterBuilder::<N, f64>::default();
        let mut f = builder.build::<SIGMA>();
        let mut m = builder.observations().build::<ROWS, SIGMA>();
        f.set_alpha(1.0);
        f.set_beta(0.0);
        f.set_kappa(3.0 - N as f64);
        for i in 0..N {
            f.state_vector_mut().set_row(i, scene.x0[i]);
            for j in 0..N {
                f.estimate_covariance_mut().set_at(i, j, scene.p0[i * N + j]);
                f.direct_process_noise_mut().set_at(i, j, scene.q[i * N + j]);
            }
        }
        for r in 0..ROWS { m.measurement_noise_covariance_mut().set_at(r, r, scene.variance) }
        for t in 0..STEPS {
            f.predict_nonlinear(|next| {
                for i in (0..N).step_by(2) {
                    let moved = next.as_matrix().get_at(i, 0) + scene.dt * next.as_matrix().get_at(i + 1, 0);
                    next.as_matrix_mut().set_at(i, 0, moved);
                }
            });
            for r in 0..ROWS { m.measurement_vector_mut().set_row(r, scene.z[ROWS * t + r]) }
            f.correct_sigma_point(&mut m, |sigma, seen| {
                for k in 0..SIGMA {
                    for r in 0..ROWS { seen[r * SIGMA + k] = scene.h(r, |i| sigma[i * SIGMA + k]) }
                }
            });
            if let Some(look) = look {
                let x: Vec<f64> = (0..N).map(|i| f.state_vector().get_row(i)).collect();
                let p: Vec<f64> = (0..N * N).map(|k| f.estimate_covariance().as_matrix().get_at(k / N, k % N)).collect();
                look(t, &x, &p)
            }
        }
    });
    measure(scene, 2, "minikalman", |look| {
        let builder = minikalman::extended::builder::KalmanFilterBuilder::<N, f64>::default();
        let mut f = builder.build();
        let mut m = builder.observations().build::<ROWS>();
        for i in 0..N {
            f.state_vector_mut().set_row(i, scene.x0[i]);
            for j in 0..N {
                f.estimate_covariance_mut().set_at(i, j, scene.p0[i * N + j]);
                f.direct_process_noise_mut().set_at(i, j, scene.q[i * N + j]);
            }
            f.state_transition_jacobian_mut().set_at(i, i, 1.0);
            if i % 2 == 0 { f.state_transition_jacobian_mut().set_at(i, i + 1, scene.dt) }
        }
        for r in 0..ROWS { m.measurement_noise_covariance_mut().set_at(r, r, scene.variance) }
        for t in 0..STEPS {
            f.predict_nonlinear(|x, next| {
                for i in 0..N { next[i] = if i % 2 == 0 { x[i] + scene.dt * x[i + 1] } else { x[i] } }
            });
            for r in 0..ROWS {
                m.measurement_vector_mut().set_row(r, scene.z[ROWS * t + r]);
                for j in 0..N {
                    let value = scene.jacobian(r, j, |i| f.state_vector().get_row(i));
                    m.observation_jacobian_matrix_mut().set_at(r, j, value);
                }
            }
            f.correct_nonlinear(&mut m, |x, seen| {
                for r in 0..ROWS { seen[r] = scene.h(r, |i| x[i]) }
            });
            if let Some(look) = look {
                let x: Vec<f64> = (0..N).map(|i| f.state_vector().get_row(i)).collect();
                let p: Vec<f64> = (0..N * N).map(|k| f.estimate_covariance().as_matrix().get_at(k / N, k % N)).collect();
                look(t, &x, &p)
            }
        }
    }) && unscented
}

fn main() {
    let folder = env::args().nth(1).unwrap_or_else(|| {
        eprintln!("usage: unscented FOLDER");
        process::exit(2)
    });
    let mut good = true;
    for name in ["ranges", "bearings", "space"] {
        let scene = read(&folder, name);
        good &= kalman_filters(&scene);
        good &= if scene.n == 4 { minikalman::<4, 9>(&scene) } else { minikalman::<6, 13>(&scene) };
    }
    process::exit(if good { 0 } else { 1 })
}
