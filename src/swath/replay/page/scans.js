// Scans with their beams, the edge as it was, as it is and as it was detected, and what cameras see.

const TRAIL_S = 0.7, SCAN_PAINT = [[0.0, 0.36, 0.72], [0.46, 0.16, 0.58], [0.0, 0.48, 0.42], [0.62, 0.30, 0.0]];
const ORANGE = [0.93, 0.34, 0.0], GREEN = [0.0, 0.55, 0.38], INK = [0.1, 0.1, 0.1];

class Scans {
  constructor(gl, data, machines, flat) {
    this.gl = gl;
    this.flat = flat;
    this.scanners = data.scanners.map((scanner, k) => {
      const machine = machines[scanner.machine], starts = data[`scan_starts_${k}`];
      const points = data[`scan_points_${k}`], middle = data[`scan_middle_${k}`], scanTimes = data[`scan_times_${k}`];
      const rows = new Float32Array(points.length / 3 * 8), all = new Float32Array(points.length);
      for (let i = 0, n = 0; i < scanTimes.length; i++) {
        for (; n < starts[i + 1]; n++) {
          for (let a = 0; a < 3; a++) all[3 * n + a] = middle[3 * i + a] + points[3 * n + a] * scanner.unit_m;
          rows.set([all[3 * n], all[3 * n + 1], all[3 * n + 2], 0, 0, 0, -1, 0], 8 * n);
        }
      }
      const mount = machine.sensors.find((s) => s.slot === scanner.slot);
      const buffer = makeBuffer(gl, rows), object = makeArrayObject(gl, buffer, [3, 4, 1]);
      return { machine, slot: scanner.slot, unit: scanner.unit_m, starts, scanTimes, all, mount, buffer, object, paint: SCAN_PAINT[k % 4] };
    });
  }

  draw(view, t, options) {
    const { gl, flat } = this;
    for (const scanner of this.scanners) {
      const last = lastAt(scanner.scanTimes, t + 1e-6, -1);
      if (last < 0 || t - scanner.scanTimes[last] > TRAIL_S) continue;
      if (options.beams && scanner.mount) this.drawBeams(view, scanner, last);
      if (!options.scans) continue;
      gl.bindVertexArray(scanner.object);
      for (let i = last; i >= 0 && t - scanner.scanTimes[i] < TRAIL_S; i--) {
        const age = (t - scanner.scanTimes[i]) / TRAIL_S;
        flat.use(view, [...scanner.paint, 1 - 0.75 * age], view.dot * (i === last ? 1.25 : 0.8), true);
        gl.drawArrays(gl.POINTS, scanner.starts[i], scanner.starts[i + 1] - scanner.starts[i]);
      }
    }
  }

  drawBeams(view, scanner, i) {
    const { gl, flat } = this, from = applied(scanner.machine.pose(scanner.scanTimes[i]), scanner.mount.position), rows = [];
    for (let n = scanner.starts[i]; n < scanner.starts[i + 1]; n++) {
      rows.push(...from, 0, 0, 0, -1, 0, scanner.all[3 * n], scanner.all[3 * n + 1], scanner.all[3 * n + 2], 0, 0, 0, -1, 0);
    }
    flat.use(view, [0.1, 0.42, 0.85, 0.13], 1);
    flat.draw(gl.LINES, rows);
  }
}

class Edges {
  constructor(gl, data, machines, ground, flat) {
    this.gl = gl;
    this.flat = flat;
    this.ground = ground;
    this.machines = machines;
    this.initial = machines.map((machine, k) => {
      const points = [], raw = data[`edge_${k}`];
      for (let i = 0; i < raw.shape[0]; i++) points.push([raw[3 * i], raw[3 * i + 1], raw[3 * i + 2] + 0.08]);
      return points;
    });
  }

  // A place of a machine's frame on the ground.
  onGround(pose, x, y) {
    const p = applied(pose, [x, y, 0]);
    return [p[0], p[1], this.ground.heightAt(p[0], p[1]) + 0.1];
  }

  detected(machine, t) {
    const { track } = machine, at = track.row(t), col = track.columns;
    if (!col.edge_offset_m || Number.isNaN(col.edge_offset_m[at])) return [];
    const pose = machine.pose(col.edge_t_s[at]), offset = col.edge_offset_m[at], points = [];
    const slope = Math.tan(col.edge_heading_rad[at] || 0), reference = col.edge_reference_m[at] || 0;
    for (let d = -2; d <= 5; d += 0.5) points.push(this.onGround(pose, reference + d, offset + slope * d));
    return points;
  }

  truth(machine, t) {
    const { track } = machine, at = track.row(t), col = track.columns;
    if (!col.edge_true_m || Number.isNaN(col.edge_true_m[at])) return [];
    const p = [col.edge_reference_m[at] || 0, col.edge_true_m[at]], pose = machine.pose(col.edge_t_s[at]);
    return [[-0.35, 0], [0.35, 0]].map(([dx, dy]) => this.onGround(pose, p[0] + dx, p[1] + dy));
  }

  draw(view, t) {
    const { gl, flat } = this, seen = [], exact = [], before = [];
    this.machines.forEach((machine, k) => {
      before.push(...lineRows(this.initial[k], 0.06, 0.9));
      seen.push(...lineRows(this.detected(machine, t), 0.09));
      exact.push(...lineRows(this.truth(machine, t), 0.22));
    });
    const each = [[before, INK, 1.5, 0.75, 0.12], [seen, ORANGE, 3, 1, 0.7], [exact, GREEN, 5, 1, 0.7]];
    for (const [rows, paint, dots, strong, weak] of each) {
      if (!rows.length) continue;
      flat.use(view, [...paint, strong], dots);
      flat.draw(gl.TRIANGLES, rows);
      gl.disable(gl.DEPTH_TEST);
      flat.use(view, [...paint, weak], dots);
      flat.draw(gl.TRIANGLES, rows);
      gl.enable(gl.DEPTH_TEST);
    }
  }

  // The image of every camera as a pyramid of 5 m.
  drawFrusta(view, t) {
    const rows = [];
    for (const machine of this.machines) {
      for (const sensor of machine.sensors) {
        if (!sensor.frustum) continue;
        const m = times(machine.pose(t), frameMatrix(sensor.position, sensor.rotation)), [a, b] = sensor.frustum;
        const tip = applied(m, [0, 0, 0]), far = [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([i, j]) => applied(m, [5, 5 * a * i, 5 * b * j]));
        far.forEach((p, i) => {
          for (const q of [tip, p, p, far[(i + 1) % 4]]) rows.push(...q, 0, 0, 0, -1, 0);
        });
      }
    }
    if (!rows.length) return;
    this.flat.use(view, [0.1, 0.1, 0.1, 0.8], 1);
    this.flat.draw(this.gl.LINES, rows);
  }
}
