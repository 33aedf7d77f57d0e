// Before native functions of detector_kernel.py, after numbers.cpp: the rows of a world.

Row& row = *(Row*)m.row.data;
const auto& d = row.detector;
auto& step = row.step;
auto& s = row.canopy;
auto& b = row.counted;
const auto& track = row.block;
Beam* beams = (Beam*)m.beams.data;
const int beam_count = (int)s.beams;
Ray* rays = (Ray*)m.scratch.data;
D *seen_x = m.scratch.data + sizeof(Ray) / sizeof(D) * beam_count, *seen_u = seen_x + beam_count, *seen_z = seen_u + beam_count;

