// Embree without Python between: a scene at its best build quality, rays one by one or in packets of 4, 8, 16.
//
// Built by embree.py against the library that embreex brings along, whose headers are not: what is used of the interface
// of Embree 4 is declared here (https://github.com/RenderKit/embree, include/embree4).

#include <cstddef>
#include <cstring>

extern "C" {
typedef struct Device* RTCDevice;
typedef struct Scene* RTCScene;
typedef struct Geometry* RTCGeometry;
RTCDevice rtcNewDevice(const char* config);
long rtcGetDeviceProperty(RTCDevice device, int property);
RTCScene rtcNewScene(RTCDevice device);
void rtcSetSceneFlags(RTCScene scene, int flags);
void rtcSetSceneBuildQuality(RTCScene scene, int quality);
void rtcCommitScene(RTCScene scene);
void rtcReleaseScene(RTCScene scene);
RTCGeometry rtcNewGeometry(RTCDevice device, int type);
void rtcSetGeometryBuildQuality(RTCGeometry geometry, int quality);
void rtcSetSharedGeometryBuffer(RTCGeometry geometry, int type, unsigned slot, int format, const void* data, size_t offset,
                                size_t stride, size_t count);
void rtcCommitGeometry(RTCGeometry geometry);
unsigned rtcAttachGeometry(RTCScene scene, RTCGeometry geometry);
void rtcReleaseGeometry(RTCGeometry geometry);
struct Arguments {
  int flags;
  unsigned features;
  void *context, *filter, *intersect;
};
void rtcIntersect1(RTCScene scene, void* ray, Arguments* args);
void rtcIntersect4(const int* valid, RTCScene scene, void* rays, Arguments* args);
void rtcIntersect8(const int* valid, RTCScene scene, void* rays, Arguments* args);
void rtcIntersect16(const int* valid, RTCScene scene, void* rays, Arguments* args);
}

namespace {
constexpr int TRIANGLE = 0, INDEX = 0, VERTEX = 1, UINT3 = 0x5003, FLOAT3 = 0x9003, COHERENT = 1 << 16;
constexpr unsigned NOTHING = ~0u;

template <int N>
struct alignas(64) Rays {  // RTCRayHitN: a ray, then its hit; room for what later versions add
  float ox[N], oy[N], oz[N], near[N], dx[N], dy[N], dz[N], time[N], far[N];
  unsigned mask[N], id[N], flags[N];
  float nx[N], ny[N], nz[N], u[N], v[N];
  unsigned primitive[N], geometry[N], instance[8 * N];
};

template <int N>
void cast(RTCScene scene, const float* origins, const float* directions, size_t count, float range_max, bool coherent, float* out) {
  Arguments args = {coherent ? COHERENT : 0, ~0u, nullptr, nullptr, nullptr};
  Rays<N> rays;
  std::memset(&rays, 0, sizeof rays);
  alignas(64) int valid[N];
  for (size_t i = 0; i < count; i += N) {
    for (int l = 0; l < N; ++l) {
      const size_t k = i + l < count ? i + l : i;
      valid[l] = i + l < count ? -1 : 0;
      const float *o = origins + 3 * k, *d = directions + 3 * k;
      rays.ox[l] = o[0], rays.oy[l] = o[1], rays.oz[l] = o[2];
      rays.dx[l] = d[0], rays.dy[l] = d[1], rays.dz[l] = d[2];
      rays.near[l] = 0.0f, rays.far[l] = range_max, rays.mask[l] = ~0u, rays.geometry[l] = NOTHING;
    }
    if constexpr (N == 1) rtcIntersect1(scene, &rays, &args);
    if constexpr (N == 4) rtcIntersect4(valid, scene, &rays, &args);
    if constexpr (N == 8) rtcIntersect8(valid, scene, &rays, &args);
    if constexpr (N == 16) rtcIntersect16(valid, scene, &rays, &args);
    for (int l = 0; l < N && i + l < count; ++l) out[i + l] = rays.far[l];
  }
}
}  // namespace

extern "C" {
// Triangles (faces, 3) over vertices (n, 3), kept by the caller; quality: 0 low, 1 medium, 2 high; robust: no ray slips
// between two triangles, slower
void* build(const float* vertices, size_t vertex_count, const unsigned* faces, size_t face_count, int quality, int robust) {
  static RTCDevice device = rtcNewDevice(nullptr);
  RTCScene scene = rtcNewScene(device);
  rtcSetSceneFlags(scene, robust ? 4 : 0);
  rtcSetSceneBuildQuality(scene, quality);
  RTCGeometry mesh = rtcNewGeometry(device, TRIANGLE);
  rtcSetGeometryBuildQuality(mesh, quality);
  rtcSetSharedGeometryBuffer(mesh, VERTEX, 0, FLOAT3, vertices, 0, 12, vertex_count);
  rtcSetSharedGeometryBuffer(mesh, INDEX, 0, UINT3, faces, 0, 12, face_count);
  rtcCommitGeometry(mesh);
  rtcAttachGeometry(scene, mesh);
  rtcReleaseGeometry(mesh);
  rtcCommitScene(scene);
  return scene;
}
void release(void* scene) { rtcReleaseScene((RTCScene)scene); }

// Distances (count,) to the nearest triangle, range_max where there is none; width: rays in a packet
void intersect(void* scene, const float* origins, const float* directions, size_t count, float range_max, int width, int coherent,
               float* out) {
  RTCScene s = (RTCScene)scene;
  if (width == 1) cast<1>(s, origins, directions, count, range_max, coherent, out);
  if (width == 4) cast<4>(s, origins, directions, count, range_max, coherent, out);
  if (width == 8) cast<8>(s, origins, directions, count, range_max, coherent, out);
  if (width == 16) cast<16>(s, origins, directions, count, range_max, coherent, out);
}
}
