// Where a machine is that stood at a step's place when its scan ended, some seconds after that: along its heading, and aside by
// crab, the side slip of the fixed axle per side force in g
struct Frame { D x, u, angle; };
auto moved = [](const auto& d, const auto& step, D seconds) {
  const D crab = d.crab * (step.rise + d.sign * step.speed * step.yaw_rate / GRAVITY);
  const D course = step.heading + 0.5 * step.yaw_rate * seconds - d.sign * crab, way = step.speed * seconds;
  return Frame{step.x + way * ::cos(course), step.u + way * ::sin(course), step.heading + step.yaw_rate * seconds};
};
