// The laser scan as a plan view: the camera is at the bottom and looks up.

const HEIGHT_PART = 0.75;

// Draws a scan. Rings are at whole or half metres.
export function drawPlan(canvas, scan) {
  const width = Math.round(canvas.clientWidth * devicePixelRatio) || 400;
  const height = Math.round(width * HEIGHT_PART);
  Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d");
  const seen = scan.ranges_mm.filter((mm) => mm > 0).sort((a, b) => a - b);
  const reach = Math.max(1000, (seen[Math.floor(0.95 * (seen.length - 1))] ?? 0) * 1.15);
  const scale = (height * 0.88) / reach;
  const [x0, y0] = [width / 2, height * 0.95];
  const place = (bearing, mm) => [x0 - Math.sin(bearing) * mm * scale, y0 - Math.cos(bearing) * mm * scale];
  const bearingOf = (i) => scan.bearing_min_rad + i * scan.bearing_step_rad;

  context.fillStyle = "#0a0d10";
  context.fillRect(0, 0, width, height);
  context.font = `${Math.round(12 * devicePixelRatio)}px system-ui, sans-serif`;
  const step = [500, 1000, 2000, 5000].find((mm) => reach / mm <= 6) ?? 10000;
  context.strokeStyle = "#33414d";
  context.fillStyle = "#98a6b3";
  context.lineWidth = devicePixelRatio;
  for (let mm = step; mm <= reach * 1.2; mm += step) {
    context.beginPath();
    context.arc(x0, y0, mm * scale, Math.PI, 2 * Math.PI);
    context.stroke();
    context.fillText(`${mm / 1000} m`, x0 + 4 * devicePixelRatio, y0 - mm * scale - 4 * devicePixelRatio);
  }
  // The field of view, half a step beyond the bearings at its ends.
  context.strokeStyle = "#4c5d6b";
  for (const bearing of [bearingOf(-0.5), bearingOf(scan.ranges_mm.length - 0.5)]) {
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(...place(bearing, reach * 1.3));
    context.stroke();
  }
  // What is free, and what is seen.
  scan.ranges_mm.forEach((mm, i) => {
    if (mm === 0) return;
    context.fillStyle = "#5ac3e633";
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(...place(bearingOf(i - 0.5), mm));
    context.lineTo(...place(bearingOf(i + 0.5), mm));
    context.fill();
    context.strokeStyle = "#ffb04a";
    context.lineWidth = 3 * devicePixelRatio;
    context.beginPath();
    context.moveTo(...place(bearingOf(i - 0.5), mm));
    context.lineTo(...place(bearingOf(i + 0.5), mm));
    context.stroke();
  });
  context.fillStyle = "#e4eaef";
  context.beginPath();
  context.arc(x0, y0, 4 * devicePixelRatio, 0, 2 * Math.PI);
  context.fill();
}
