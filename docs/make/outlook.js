// What a picture of a run shows, from the page's own data: machines, what stands beside their paths, what is
// special in the edge and in the scans; and the free camera from which it is all in the picture, as large as can be.
(near) => {
  const { applied, cross, moved, placeOn, times, unit, CAMERAS, FOV } = swath.geometry;
  const { app } = swath, { machines, cameras, time } = app, corners = ([x0, x1, y, z0, z1], m) =>
    [x0, x1].flatMap((x) => [-y, y].flatMap((v) => [z0, z1].map((z) => applied(m, [x, v, z]))));
  const bodies = machines.map((m) => {
    const [width, knife, middle, , deep] = m.header, [rear, front, half, bottom, top] = m.body, pose = m.pose(time);
    const found = corners([rear, front, half, bottom, top], pose);
    if (width > 0) found.push(...corners([knife - deep, knife + 1, width / 2, 0, 1], times(pose, moved(0, middle, 0))));
    if (m.trailerShape && m.box) found.push(...corners([-m.box.length / 2, m.box.length / 2, m.box.width / 2, 0, 3], m.trailerPose(time)));
    return found;
  });
  const away = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1]), own = machines[0], middle = applied(own.pose(time), [3, 0, 0]);
  const things = app.things.items.map((thing) => {
    const m = thing.way ? times(placeOn(thing.way, time), thing.body) : thing.body, c = applied(m, [0, 0, 0]);
    return [c, [c[0], c[1], c[2] + thing.half[2]]];
  }).filter(([c]) => away(c, middle) < 30);
  const heading = (a, b) => Math.atan2(b[1] - a[1], b[0] - a[0]), spread = (angles) =>
    Math.max(...angles.map((a) => Math.abs(Math.atan2(Math.sin(a - angles[0]), Math.cos(a - angles[0])))));
  const ahead = app.edges.initial[0].filter((p) => away(p, middle) < 32), turns = ahead.slice(1).map((p, k) => heading(ahead[k], p));
  const bend = ahead.length > 2 && spread(turns) > 0.15 ? ahead : [];
  const several = app.scans.scanners.filter((s) => s.machine === own).length > 1;
  const echoes = several ? app.scans.scanners.flatMap((s) => {
    const i = app.scans.last(s, time), points = [];
    for (let n = s.starts[i]; n < s.starts[i + 1]; n += 5) points.push([s.all[3 * n], s.all[3 * n + 1], s.all[3 * n + 2]]);
    return points.filter((p) => away(p, middle) < 14);
  }) : [];
  const [width, knife, shift] = own.header, side = own.side === "right" ? -1 : 1, yaw = own.calmYaw(time);
  const end = applied(own.pose(time), [knife, shift + side * width / 2, 0.5]);
  let all = [...bodies.flat(), ...things.flat(), ...(several ? echoes : bend)];
  if (near) all = [end, applied(own.pose(time), [knife + 5, shift + side * width / 2, 0]), applied(own.pose(time), [knife - 3, shift + side * width / 2 + 2, 0]), applied(own.pose(time), [knife, 0, 2])];
  const tall = Math.tan(FOV / 2) * 0.88, wide = tall * app.canvas.width / app.canvas.height;
  const fit = (turn, pitch) => {
    const back = [Math.cos(turn) * Math.cos(pitch), Math.sin(turn) * Math.cos(pitch), Math.sin(pitch)];
    const right = unit(cross([0, 0, 1], back)), up = cross(back, right), dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const at = all.map((p) => [dot(p, right), dot(p, up), dot(p, back)]), mid = (k) => (Math.min(...at.map((p) => p[k])) + Math.max(...at.map((p) => p[k]))) / 2;
    const c = [mid(0), mid(1), mid(2)], far = Math.max(...at.map((p) => Math.max(Math.abs(p[0] - c[0]) / wide, Math.abs(p[1] - c[1]) / tall) + p[2] - c[2]));
    const seen = (p) => { const d = far - (dot(p, back) - c[2]); return [(dot(p, right) - c[0]) / d, (dot(p, up) - c[1]) / d, d]; };
    const frame = bodies.map((body) => { const s = body.map(seen); return [0, 1].map((k) => [Math.min(...s.map((p) => p[k])), Math.max(...s.map((p) => p[k]))]).concat([Math.min(...s.map((p) => p[2]))]); });
    const hidden = [...things.map((t) => t[1]), ...(width > 0 ? [end] : [])].map(seen).filter((p) => frame.some(([x, y, d]) => p[0] > x[0] && p[0] < x[1] && p[1] > y[0] && p[1] < y[1] && p[2] > d + 3)).length;
    const covered = frame.slice(1).filter(([x], k) => Math.min(x[1], frame[0][0][1]) - Math.max(x[0], frame[0][0][0]) > 0.5 * (x[1] - x[0])).length;
    return { turn, pitch, far, hidden: hidden + covered, target: [0, 1, 2].map((i) => c[0] * right[i] + c[1] * up[i] + c[2] * back[i]) };
  };
  // From the side of the cut crop first, where the edge is seen; level views where all stands close, high ones else.
  const reach = Math.max(...all.map((p) => away(p, middle))), pitch = reach > 25 ? 0.62 : reach > 14 ? 0.42 : 0.3;
  const views = [2.5, 2.1, 1.7, 1.2, 0.8, 2.9, -2.5, -1.9].map((a) => fit(yaw + side * a, near ? 0.35 : pitch));
  const best = views.reduce((a, b) => (b.hidden < a.hidden || (b.hidden === a.hidden && b.far < 0.85 * a.far) ? b : a));
  cameras.choose(CAMERAS.findIndex((c) => c.name === "free"));
  cameras.target = best.target;
  cameras.own[cameras.at] = { yaw: best.turn, pitch: best.pitch, away: best.far };
  app.touch();
  return { turn: best.turn - yaw, pitch: best.pitch, away: best.far, hidden: best.hidden, things: things.length, bend: bend.length, echoes: echoes.length };
}
