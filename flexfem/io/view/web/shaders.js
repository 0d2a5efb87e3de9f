// Programs of the graphics processor. Everything moves there: between two instants A and B that are
// uploaded, by the part "mixing" of the way.

const HEAD = /* glsl */ `
precision highp float;
precision highp int;
precision highp isampler2D;
uniform mat4 modelViewMatrix;
uniform mat4 projectionMatrix;
uniform float mixing;
uniform vec3 offset;
uniform float scale;
`;

const VALUES = /* glsl */ `
in float valueA;
in float valueB;
out float value;
flat out float elementValue;
const float MISSING = 1e30;
void passValue() {
  value = max(valueA, valueB) >= MISSING ? 2.0 * MISSING : mix(valueA, valueB, mixing);
  elementValue = value;
}
`;

const CELL = /* glsl */ `
in uint cell;
flat out uint shownCell;
`;

/** Vertices that are fixed in frames, whose places and rotations are in two textures. */
export const FRAMES = /* glsl */ `${HEAD}${VALUES}${CELL}
uniform isampler2D framesA;
uniform isampler2D framesB;
uniform float growth;
in vec3 local;
in vec3 normal;
in uint frame;
out vec3 shownNormal;
out vec3 seen;
vec3 rotated(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
void main() {
  int width = textureSize(framesA, 0).x;
  int at = 2 * int(frame);
  ivec2 first = ivec2(at % width, at / width);
  ivec2 second = ivec2((at + 1) % width, (at + 1) / width);
  vec3 place = mix(
    vec3(texelFetch(framesA, first, 0).xyz), vec3(texelFetch(framesB, first, 0).xyz), mixing);
  vec4 turn = normalize(mix(
    vec4(texelFetch(framesA, second, 0)), vec4(texelFetch(framesB, second, 0)), mixing));
  vec4 position = modelViewMatrix * vec4(offset + scale * place + rotated(turn, growth * local), 1.0);
  shownNormal = mat3(modelViewMatrix) * rotated(turn, normal);
  seen = position.xyz;
  shownCell = cell;
  passValue();
  gl_Position = projectionMatrix * position;
}
`;

/** Vertices that all move for themselves. */
export const POINTS = /* glsl */ `${HEAD}${VALUES}${CELL}
in vec3 placeA;
in vec3 placeB;
in vec3 normalA;
in vec3 normalB;
out vec3 shownNormal;
out vec3 seen;
void main() {
  vec4 position = modelViewMatrix * vec4(offset + scale * mix(placeA, placeB, mixing), 1.0);
  shownNormal = mat3(modelViewMatrix) * mix(normalA, normalB, mixing);
  seen = position.xyz;
  shownCell = cell;
  passValue();
  gl_Position = projectionMatrix * position;
}
`;

/** Lines as ribbons of a width in pixels; "side" is the corner of the ribbon. */
export const LINES = /* glsl */ `${HEAD}${CELL}
uniform vec2 window;
uniform float width;
in vec2 side;
in vec3 startPlace;
in vec3 endPlace;
in float startValue;
in float endValue;
out float value;
flat out float elementValue;
out vec3 shownNormal;
out vec3 seen;
void main() {
  vec4 a = projectionMatrix * modelViewMatrix * vec4(startPlace, 1.0);
  vec4 b = projectionMatrix * modelViewMatrix * vec4(endPlace, 1.0);
  vec2 along = (b.xy / b.w - a.xy / a.w) * window;
  along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
  vec2 across = vec2(-along.y, along.x);
  vec4 position = mix(a, b, side.x);
  vec2 shift = width * (side.y * across + (2.0 * side.x - 1.0) * 0.5 * along);
  position.xy += shift / window * position.w;
  shownNormal = vec3(across * side.y, 0.5);
  seen = vec3(0.0, 0.0, -1.0);
  value = mix(startValue, endValue, side.x);
  elementValue = startValue;
  shownCell = cell;
  gl_Position = position;
}
`;

/** Arrows along "vector" from "place", which are the same for all vertices of one. */
export const ARROWS = /* glsl */ `${HEAD}
uniform float thickness;
in vec3 local;
in vec3 normal;
in vec3 place;
in vec3 vector;
out float value;
flat out float elementValue;
flat out uint shownCell;
out vec3 shownNormal;
out vec3 seen;
void main() {
  float size = length(vector);
  vec3 z = size > 0.0 ? vector / size : vec3(0.0, 0.0, 1.0);
  vec3 x = normalize(cross(abs(z.x) < 0.9 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0), z));
  mat3 axes = mat3(x, cross(z, x), z);
  float head = min(8.0 * thickness, 0.5 * size);
  float thick = min(thickness, 0.0625 * size);
  vec3 drawn = vec3(thick * local.xy, local.z < 1.0 ? 0.0 : size - head * (2.0 - local.z));
  vec4 position = modelViewMatrix * vec4(place + axes * drawn, 1.0);
  shownNormal = mat3(modelViewMatrix) * axes * normal;
  seen = position.xyz;
  value = elementValue = 0.0;
  shownCell = 0u;
  gl_Position = size > 2.0 * thickness ? projectionMatrix * position : vec4(2.0, 2.0, 2.0, 1.0);
}
`;

const FRAGMENT_HEAD = /* glsl */ `
precision highp float;
precision highp int;
in float value;
flat in float elementValue;
flat in uint shownCell;
in vec3 shownNormal;
in vec3 seen;
`;

/** Colours by a field or of one kind, lit from the viewer's upper left. */
export const SHADED = /* glsl */ `${FRAGMENT_HEAD}
uniform sampler2D colours;
uniform vec2 range;
uniform vec3 plain;
uniform vec3 missing;
uniform bool coloured;
uniform bool byElement;
uniform float picked;
uniform mat4 projectionMatrix;
out vec4 colour;
void main() {
  vec3 base = plain;
  float shown = byElement ? elementValue : value;
  if (coloured) {
    float place = (shown - range.x) / max(range.y - range.x, 1e-30);
    base = shown >= 1e30 ? missing : texture(colours, vec2(clamp(place, 0.0, 1.0), 0.5)).rgb;
  }
  vec3 n = normalize(shownNormal);
  // to the viewer: parallel in an orthographic projection
  vec3 viewer = projectionMatrix[3][3] > 0.5 ? vec3(0.0, 0.0, 1.0) : normalize(-seen);
  if (dot(n, viewer) < 0.0) n = -n;
  float key = max(dot(n, normalize(vec3(-0.4, 0.65, 0.7))), 0.0);
  float fill = max(dot(n, normalize(vec3(0.7, -0.1, 0.5))), 0.0);
  float light = 0.6 + 0.42 * key + 0.12 * fill;
  float gloss = pow(max(dot(reflect(-normalize(vec3(-0.4, 0.65, 0.7)), n), viewer), 0.0), 24.0);
  colour = vec4(base * light + 0.13 * gloss, 1.0);
  if (picked >= 0.0 && abs(float(shownCell) - picked) < 0.5) colour.rgb = mix(colour.rgb, vec3(1.0), 0.35);
}
`;

/** Edges of elements: a darker tone, whatever is below. */
export const EDGES = /* glsl */ `${FRAGMENT_HEAD}
out vec4 colour;
void main() { colour = vec4(0.05, 0.08, 0.12, 0.3); }
`;

/** Number of the layer, number of the cell, and depth. */
export const PICKED = /* glsl */ `${FRAGMENT_HEAD}
uniform float layer;
out vec4 colour;
void main() { colour = vec4(layer, float(shownCell), gl_FragCoord.z, 1.0); }
`;
