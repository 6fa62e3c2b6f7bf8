"use strict";
// Top view: map, path, covariance, scan and cars. Metres, x right, y up.
const Floor = (() => {
  const MAX_PATH_POINTS = 6000, MIN_BODY_PX = 16, BODY = [0.30, 0.19, 0.0625];  // body of a car [m]: length, width, rear overhang
  const canvas = document.getElementById("floor"), pen = canvas.getContext("2d");
  let scale = 90, centre = [0, 0], follow = true, dirty = true;
  const path = [];
  let car = null, scan = [], map = [], others = [];

  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
  const px = (x, y) => [canvas.width / 2 + (x - centre[0]) * scale * devicePixelRatio,
                        canvas.height / 2 - (y - centre[1]) * scale * devicePixelRatio];
  const line = (points, colour, width) => {
    pen.strokeStyle = colour; pen.lineWidth = width * devicePixelRatio; pen.beginPath();
    points.forEach(([x, y], n) => { const at = px(x, y); n ? pen.lineTo(...at) : pen.moveTo(...at); });
    pen.stroke();
  };

  const gridStep = () => scale > 50 ? 0.5 : scale > 12 ? 1 : 5;

  function drawGrid() {
    const step = gridStep(), k = scale * devicePixelRatio;
    const w = canvas.width / 2 / k, h = canvas.height / 2 / k;
    for (let x = Math.ceil((centre[0] - w) / step) * step; x < centre[0] + w; x += step) line([[x, centre[1] - h], [x, centre[1] + h]], style("--line"), 0.5);
    for (let y = Math.ceil((centre[1] - h) / step) * step; y < centre[1] + h; y += step) line([[centre[0] - w, y], [centre[0] + w, y]], style("--line"), 0.5);
  }

  // The text is drawn last and on a ground of its own: walls and lidar points do not cross it.
  function writeScale() {
    const text = `grid ${gridStep()} m`, k = devicePixelRatio;
    pen.font = `${12 * k}px system-ui`;
    pen.fillStyle = style("--card"); pen.fillRect(4 * k, canvas.height - 25 * k, pen.measureText(text).width + 8 * k, 21 * k);
    pen.fillStyle = style("--quiet"); pen.fillText(text, 8 * k, canvas.height - 10 * k);
  }

  // Draw the ellipse of two standard deviations of the position. The eigenvalues of the covariance are mean +- off, and
  // turn is the angle of the first eigenvector.
  function drawEllipse({ x, y, sxx, sxy, syy }) {
    if (!(sxx > 0) || !(syy > 0)) return;
    const mean = (sxx + syy) / 2, off = Math.hypot((sxx - syy) / 2, sxy), turn = Math.atan2(2 * sxy, sxx - syy) / 2;
    const k = 2 * scale * devicePixelRatio;
    pen.strokeStyle = style("--orange"); pen.lineWidth = 1.5 * devicePixelRatio; pen.beginPath();
    pen.ellipse(...px(x, y), k * Math.sqrt(mean + off), k * Math.sqrt(Math.max(mean - off, 0)), -turn, 0, 2 * Math.PI);
    pen.stroke();
  }

  function drawBody({ x, y, yaw }, colour) {
    // From far away a car is drawn larger than it is, so that it stays visible.
    const larger = Math.max(1, MIN_BODY_PX / (BODY[0] * scale));
    const [length, width, rear] = BODY.map((v) => v * larger), c = Math.cos(yaw), s = Math.sin(yaw);
    const at = (a, b) => [x + c * a - s * b, y + s * a + c * b];
    const corners = [at(-rear, -width / 2), at(length - rear, -width / 2), at(length - rear, width / 2), at(-rear, width / 2)];
    pen.fillStyle = colour; pen.beginPath();
    corners.forEach((p, n) => n ? pen.lineTo(...px(...p)) : pen.moveTo(...px(...p)));
    pen.fill();
    line([at(0, 0), at(length, 0)], style("--card"), 2);
  }

  // Show all cars, on the page that has none of its own. The view changes only if a car leaves it or it is much too large.
  function fit() {
    const MARGIN = 0.8, xs = others.map((one) => one.x), ys = others.map((one) => one.y);
    const [left, right, low, high] = [Math.min(...xs) - MARGIN, Math.max(...xs) + MARGIN, Math.min(...ys) - MARGIN, Math.max(...ys) + MARGIN];
    const k = scale * devicePixelRatio, w = canvas.width / 2 / k, h = canvas.height / 2 / k, inner = MARGIN / 2;
    const isInside = left + inner > centre[0] - w && right - inner < centre[0] + w && low + inner > centre[1] - h && high - inner < centre[1] + h;
    const best = Math.min(120, canvas.width / devicePixelRatio / (right - left), canvas.height / devicePixelRatio / (high - low));
    if (isInside && best < 1.5 * scale) return;
    scale = Math.max(2, best);
    centre = [(left + right) / 2, (low + high) / 2];
  }

  function draw() {
    requestAnimationFrame(draw);
    const box = canvas.getBoundingClientRect(), w = Math.round(box.width * devicePixelRatio), h = Math.round(box.height * devicePixelRatio);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; dirty = true; }
    if (!dirty) return;
    dirty = false;
    if (follow && car) centre = [car.x, car.y];
    else if (follow && others.length) fit();
    pen.clearRect(0, 0, canvas.width, canvas.height);
    drawGrid();
    for (const [a, b, c, d] of map) line([[a, b], [c, d]], style("--ink"), 2);
    line(path, style("--blue"), 1.5);
    pen.fillStyle = style("--red"); pen.font = `${12 * devicePixelRatio}px system-ui`;
    for (let n = 0; n < scan.length; n += 2) { const [a, b] = px(scan[n], scan[n + 1]); pen.fillRect(a - 1, b - 1, 2 * devicePixelRatio, 2 * devicePixelRatio); }
    others.forEach((other) => {
      if (other.path) line(other.path, style("--orange"), 1.5);
      drawBody(other, other.colour || style("--quiet"));
      if (other.name) { pen.fillStyle = style("--ink"); pen.fillText(other.name, ...px(other.x + 0.3, other.y + 0.12)); }
    });
    if (car) { drawEllipse(car); drawBody(car, style("--blue")); }
    writeScale();
  }

  // By hand the view of all cars no longer fits itself.
  const zoom = (factor) => { if (!car) follow = document.getElementById("follow").checked = false; scale = Math.min(400, Math.max(4, scale * factor)); dirty = true; };
  document.getElementById("near").onclick = () => zoom(1.4);
  document.getElementById("far").onclick = () => zoom(1 / 1.4);
  document.getElementById("follow").onchange = (event) => { follow = event.target.checked; dirty = true; };
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(event.deltaY < 0 ? 1.15 : 1 / 1.15); }, { passive: false });
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    follow = document.getElementById("follow").checked = false;
    centre = [centre[0] - event.movementX / scale, centre[1] + event.movementY / scale];
    dirty = true;
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { dirty = true; });
  requestAnimationFrame(draw);

  return {
    add(row) {
      if (row.x === null || row.y === null) return;
      if (car && Math.hypot(row.x - car.x, row.y - car.y) > 0.5) path.length = 0;  // a jump: the frame of reference has changed
      path.push([row.x, row.y]);
      if (path.length > MAX_PATH_POINTS) path.splice(0, path.length - MAX_PATH_POINTS);
      car = row; dirty = true;
    },
    clear() { path.length = 0; car = null; dirty = true; },
    scan(points) { scan = points; dirty = true; },
    map(lines) { map = lines; dirty = true; },
    others(list) { others = list; dirty = true; },
  };
})();
