// The bytes of a packed scene as columns; the layout is specified in ../src/viewer/pack.rs.

export function unpack(buffer) {
  const view = new DataView(buffer);
  const count = view.getUint32(0, true);
  const fastest = view.getFloat32(4, true);
  let offset = 8;
  const column = (Type, width) => {
    const values = new Type(buffer, offset, width * count);
    offset += values.byteLength;
    return values;
  };
  const scaled = (values, scale, shift = 0) => Float32Array.from(values, (value) => value * scale + shift);
  const means = column(Float32Array, 3);
  const times = column(Float32Array, 1);
  const velocities = scaled(column(Int16Array, 3), fastest / 32767);
  const logScales = scaled(column(Uint16Array, 3), 30 / 65535, -20);
  const quats = scaled(column(Int16Array, 4), 1 / 32767);
  const opacities = scaled(column(Uint16Array, 1), 1 / 65535);
  const colours = scaled(column(Uint8Array, 3), 1 / 255);
  return { count, means, times, velocities, logScales, quats, opacities, colours };
}
