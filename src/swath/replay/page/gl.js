// The few calls of WebGL 2 that the parts share.

function makeProgram(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, `#version 300 es\nprecision highp float;precision highp int;\n${text}`);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(gl.getProgramInfoLog(program));
  }
  const places = {};
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
  for (let i = 0; i < count; i++) {
    const { name, type } = gl.getActiveUniform(program, i);
    places[name] = { at: gl.getUniformLocation(program, name), type };
  }
  return { program, places };
}

// Sets those of the values that the program has.
function setUniforms(gl, { places }, values) {
  for (const [name, { at, type }] of Object.entries(places)) {
    const v = values[name];
    if (v === undefined) continue;
    if (type === gl.FLOAT) gl.uniform1f(at, v);
    else if (type === gl.FLOAT_VEC2) gl.uniform2fv(at, v);
    else if (type === gl.FLOAT_VEC3) gl.uniform3fv(at, v);
    else if (type === gl.FLOAT_VEC4) gl.uniform4fv(at, v);
    else if (type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(at, false, v);
    else if (type === gl.INT_VEC2) gl.uniform2iv(at, v);
    else gl.uniform1i(at, v);  // int, bool and samplers
  }
}

// A texture of whole numbers, read by texelFetch; formats as in makeFormats.
function makeTexture(gl, unit, format, width, height, data) {
  const texture = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
  for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
  const [inner, outer, type] = makeFormats(gl)[format];
  gl.texImage2D(gl.TEXTURE_2D, 0, inner, width, height, 0, outer, type, data);
  return texture;
}

function makeFormats(gl) {
  return {
    r8: [gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE],
    rgba8: [gl.RGBA8UI, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE],
    r16: [gl.R16UI, gl.RED_INTEGER, gl.UNSIGNED_SHORT],
    rg16: [gl.RG16UI, gl.RG_INTEGER, gl.UNSIGNED_SHORT],
    rgba16: [gl.RGBA16UI, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT],
    rgba16i: [gl.RGBA16I, gl.RGBA_INTEGER, gl.SHORT],
    r32: [gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT],
  };
}

// A long row of texels in rows of 1024.
function makeRow(gl, unit, format, texels, data) {
  const rows = Math.max(1, Math.ceil(texels / 1024));
  const per = data.length / Math.max(texels, 1);
  const full = new data.constructor(rows * 1024 * Math.max(1, Math.round(per)));
  full.set(data);
  return makeTexture(gl, unit, format, 1024, rows, full);
}

function makeBuffer(gl, data, usage = gl.STATIC_DRAW) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, data, usage);
  return buffer;
}

// A vertex array of float attributes that lie in one buffer: sizes of the attributes in their order.
function makeArrayObject(gl, buffer, sizes) {
  const object = gl.createVertexArray();
  gl.bindVertexArray(object);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  const stride = 4 * sizes.reduce((a, b) => a + b, 0);
  let at = 0;
  sizes.forEach((size, place) => {
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, gl.FLOAT, false, stride, at);
    at += 4 * size;
  });
  gl.bindVertexArray(null);
  return object;
}

const FOG = `
uniform vec3 sky;
vec3 hazed(vec3 c, float away) { return mix(c, sky, clamp((away - 40.) / 220., 0., .85)); }
`;
