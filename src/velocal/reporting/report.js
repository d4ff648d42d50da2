"use strict";
// What the report can do with scripts: sorted tables, details of a laser, maps of residuals, the
// planes and an interior in space. Without scripts the page shows the same numbers in tables and pictures.
(function () {
  const root = document.documentElement;
  const holder = document.getElementById("maps");
  const data = holder ? JSON.parse(holder.textContent) : { samples: [] };
  root.classList.add("scripted");

  function decoded(text, Type) {
    const bytes = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
    if (Type === Uint8Array) return bytes;
    const view = new DataView(bytes.buffer);
    const result = new Type(bytes.length / 2);
    for (let i = 0; i < result.length; i++) {
      result[i] = Type === Uint16Array ? view.getUint16(2 * i, true) : view.getInt16(2 * i, true);
    }
    return result;
  }

  for (const one of data.samples) {
    one.laser = decoded(one.laser, Uint8Array);
    one.plane = decoded(one.plane, Uint8Array);
    one.azimuth_bin = decoded(one.azimuth_bin, Uint16Array);
    one.states = { before: decoded(one.before, Int16Array), after: decoded(one.after_s, Int16Array) };
    for (const axis of ["x", "y", "z"]) one[axis] = decoded(one[axis], Int16Array);
  }
  const bins = Math.round(360 / (data.step_deg || 1));
  const samplesOf = (scanner) => data.samples.filter((one) => one.scanner === scanner);
  const number = (value, decimals) => value.toFixed(decimals).replace("-", "\u2212");
  const style = (name) => getComputedStyle(root).getPropertyValue(name).trim();

  function element(name, attributes, parent, text) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    if (parent) parent.appendChild(made);
    return made;
  }

  // Tables that can be sorted -------------------------------------------------------------------

  function valueOf(row, column) {
    const text = row.cells[column].textContent.trim();
    const found = parseFloat(text.replace("\u2212", "-"));
    return Number.isNaN(found) ? text : found;
  }

  function sort(table, column, heading) {
    const falling = heading.getAttribute("aria-sort") === "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", falling ? "descending" : "ascending");
    const body = table.tBodies[0];
    const rows = Array.from(body.rows);
    rows.sort((a, b) => {
      const [first, second] = [valueOf(a, column), valueOf(b, column)];
      const order =
        typeof first === "number" && typeof second === "number"
          ? first - second
          : typeof first === typeof second
            ? first.localeCompare(second)
            : typeof first === "number" ? -1 : 1;
      return falling ? -order : order;
    });
    body.append(...rows);
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    Array.from(table.tHead.rows[0].cells).forEach((heading, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...heading.childNodes);
      heading.append(button);
      button.addEventListener("click", () => sort(table, column, heading));
    });
  }

  // Details of a laser --------------------------------------------------------------------------

  const WIDTH = 640;

  function frame(parent, title, height, x, y, labels) {
    const figure = document.createElement("figure");
    parent.append(figure);
    const svg = element("svg", { viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "aria-label": title, class: "plot" }, figure);
    const caption = document.createElement("figcaption");
    caption.textContent = title;
    figure.append(caption);
    const left = 48, right = WIDTH - 8, top = 8, bottom = height - 34;
    const at = {
      x: (value) => left + ((value - x[0]) / (x[1] - x[0] || 1)) * (right - left),
      y: (value) => bottom - ((value - y[0]) / (y[1] - y[0] || 1)) * (bottom - top),
      left, right, top, bottom, svg,
    };
    for (const value of ticks(y[0], y[1], 5)) {
      element("line", { x1: left, x2: right, y1: at.y(value), y2: at.y(value), class: value === 0 ? "zero" : "grid" }, svg);
      element("text", { x: left - 6, y: at.y(value) + 4, "text-anchor": "end" }, svg, number(value, labels.decimals || 0));
    }
    for (const value of ticks(x[0], x[1], 8)) {
      element("text", { x: at.x(value), y: bottom + 15, "text-anchor": "middle" }, svg, number(labels.wrap ? value % 360 : value, 0));
    }
    element("text", { x: (left + right) / 2, y: height - 4, "text-anchor": "middle" }, svg, labels.x);
    element("text", { x: 12, y: (top + bottom) / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${(top + bottom) / 2})` }, svg, labels.y);
    return at;
  }

  function ticks(low, high, wanted) {
    const rough = (high - low) / wanted || 1;
    const power = Math.pow(10, Math.floor(Math.log10(rough)));
    const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= rough);
    const found = [];
    for (let value = Math.ceil(low / step) * step; value <= high + 1e-9; value += step) found.push(Math.abs(value) < 1e-9 ? 0 : value);
    return found;
  }

  // First bin after the widest gap, so that a wall is not cut where the angle begins again.
  function start(of) {
    const seen = Array.from(new Set(of)).sort((a, b) => a - b);
    let widest = -1, first = 0;
    seen.forEach((bin, i) => {
      const next = i + 1 < seen.length ? seen[i + 1] : seen[0] + bins;
      if (next - bin > widest) [widest, first] = [next - bin, next % bins];
    });
    return first;
  }

  function residuals(sample, laser) {
    const rows = [];
    const begin = start(sample.azimuth_bin);
    sample.laser.forEach((one, i) => {
      if (one === laser) {
        const turned = (sample.azimuth_bin[i] - begin + bins) % bins;
        rows.push({
          bin: turned, angle: (begin + turned + 0.5) * data.step_deg, plane: sample.plane[i],
          before: sample.states.before[i] * data.residual_mm, after: sample.states.after[i] * data.residual_mm,
        });
      }
    });
    return rows.sort((a, b) => a.bin - b.bin);
  }

  function limits(values) {
    const low = Math.min(0, ...values), high = Math.max(0, ...values), margin = 0.06 * (high - low) || 1;
    return [low - margin, high + margin];
  }

  function along(parent, sample, rows) {
    const x = [rows[0].angle - 2, rows[rows.length - 1].angle + 2];
    const y = limits(rows.flatMap((row) => [row.before, row.after]));
    const at = frame(parent, `${sample.sample}: residuals s along the rotational angle; rings before, dots after`, 220, x, y,
      { x: "rotational angle [deg]", y: "s [mm]", wrap: true });
    let previous = null;
    for (const row of rows) {
      element("circle", { cx: at.x(row.angle), cy: at.y(row.before), r: 2, class: "before" }, at.svg);
      element("circle", { cx: at.x(row.angle), cy: at.y(row.after), r: 2, class: "after" }, at.svg);
      if (row.plane !== previous) {
        element("text", { x: at.x(row.angle), y: at.top + 9, class: "plane" }, at.svg, sample.planes[row.plane]);
        previous = row.plane;
      }
    }
  }

  function histogram(parent, rows) {
    const x = limits(rows.flatMap((row) => [row.before, row.after])), slots = 40;
    const counts = { before: new Array(slots).fill(0), after: new Array(slots).fill(0) };
    for (const row of rows) {
      for (const state of ["before", "after"]) {
        counts[state][Math.min(slots - 1, Math.floor(((row[state] - x[0]) / (x[1] - x[0])) * slots))]++;
      }
    }
    const most = Math.max(...counts.before, ...counts.after);
    const at = frame(parent, "Histogram of s, all recordings; outline before, filled after", 200, x, [0, most * 1.05], { x: "s [mm]", y: "azimuth bins" });
    for (const state of ["after", "before"]) {
      counts[state].forEach((count, i) => {
        if (!count) return;
        const from = at.x(x[0] + (i / slots) * (x[1] - x[0]));
        element("rect", { x: from, width: (at.right - at.left) / slots, y: at.y(count), height: at.bottom - at.y(count), class: state + " bar" }, at.svg);
      });
    }
  }

  function correlation(parent, perSample) {
    const lags = 40, sums = new Array(lags).fill(0), counts = new Array(lags).fill(0);
    for (const rows of perSample) {
      const mean = rows.reduce((sum, row) => sum + row.after, 0) / rows.length;
      const at = new Map(rows.map((row) => [row.bin, row.after - mean]));
      for (const [bin, value] of at) {
        for (let lag = 0; lag < lags; lag++) {
          if (at.has(bin + lag)) { sums[lag] += value * at.get(bin + lag); counts[lag]++; }
        }
      }
    }
    if (!sums[0]) return;
    const points = sums.map((sum, lag) => [lag * data.step_deg, counts[lag] ? (sum / counts[lag]) / (sums[0] / counts[0]) : null]).filter((each) => each[1] !== null);
    const at = frame(parent, "Correlation of s after the calibration with itself, by distance along the angle", 200, [0, lags * data.step_deg], [-0.6, 1.05],
      { x: "distance [deg]", y: "correlation", decimals: 1 });
    element("polyline", { points: points.map(([x, y]) => `${at.x(x)},${at.y(Math.max(-0.6, y))}`).join(" "), class: "after line" }, at.svg);
  }

  function show(section, row) {
    const laser = Number(row.dataset.laser) - 1;
    const panel = section.querySelector(".detail");
    for (const other of section.querySelectorAll("tr[aria-current]")) other.removeAttribute("aria-current");
    row.setAttribute("aria-current", "true");
    panel.replaceChildren();
    const heading = document.createElement("h4");
    heading.textContent = `Laser ${laser + 1}`;
    heading.tabIndex = -1;
    panel.append(heading);
    const note = document.createElement("p");
    note.textContent = row.dataset.note;
    const plots = document.createElement("div");
    plots.className = "plots";
    panel.append(note, plots);
    const perSample = [];
    for (const sample of samplesOf(section.dataset.scanner)) {
      const rows = residuals(sample, laser);
      if (!rows.length) continue;
      perSample.push(rows);
      along(plots, sample, rows);
    }
    if (perSample.length) {
      histogram(plots, perSample.flat());
      correlation(plots, perSample);
    } else {
      const none = document.createElement("p");
      none.textContent = "No surveyed plane was seen by this laser.";
      panel.append(none);
    }
    panel.hidden = false;
    heading.focus({ preventScroll: true });
    panel.scrollIntoView({ block: "nearest" });
  }

  for (const section of document.querySelectorAll("section.lasers")) {
    for (const row of section.querySelectorAll("tr[data-laser]")) {
      const cell = row.cells[0], button = document.createElement("button");
      button.type = "button";
      button.textContent = cell.textContent;
      button.setAttribute("aria-label", `Details of laser ${row.dataset.laser}`);
      cell.replaceChildren(button);
      row.addEventListener("click", () => show(section, row));
    }
  }

  // Colours of residuals ------------------------------------------------------------------------

  function mixed(share) {
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    const middle = dark ? [62, 68, 76] : [246, 246, 246];
    const end = share < 0 ? (dark ? [86, 170, 240] : [33, 102, 172]) : dark ? [255, 120, 90] : [178, 24, 43];
    const part = Math.min(1, Math.abs(share));
    return middle.map((value, i) => Math.round(value + part * (end[i] - value)));
  }

  // Maps: laser against angle ---------------------------------------------------------------------

  function map(holder) {
    const sample = data.samples.find((one) => one.sample === holder.dataset.sample);
    const order = JSON.parse(holder.dataset.order), limit = Number(holder.dataset.limitMm);
    const rowOf = new Map(order.map((laser, i) => [laser, order.length - 1 - i]));
    const begin = start(sample.azimuth_bin);
    const columns = 1 + sample.azimuth_bin.reduce((most, bin) => Math.max(most, (bin - begin + bins) % bins), 0);
    const controls = document.createElement("p");
    controls.className = "controls";
    const select = document.createElement("select");
    select.setAttribute("aria-label", `Planes of ${sample.sample}`);
    select.append(new Option("all planes", -1), ...sample.planes.map((name, i) => new Option(name, i)));
    controls.append("Show ", select);
    holder.append(controls);
    const readout = document.createElement("p");
    readout.className = "note readout";
    readout.textContent = "Point at a bin to read it.";
    const at = new Array(order.length * columns).fill(-1);
    const canvases = ["before", "after"].map((state) => {
      const title = document.createElement("p");
      title.className = "state";
      title.textContent = state === "before" ? "factory" : sample.after;
      const canvas = document.createElement("canvas");
      canvas.width = columns;
      canvas.height = order.length;
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `Residuals of ${sample.sample}, ${state}; the picture without scripts shows the same`);
      holder.append(title, canvas);
      canvas.addEventListener("pointermove", (event) => {
        const box = canvas.getBoundingClientRect();
        const column = Math.floor(((event.clientX - box.left) / box.width) * columns);
        const row = Math.floor(((event.clientY - box.top) / box.height) * order.length);
        const i = at[row * columns + column];
        readout.textContent = i >= 0
          ? `Laser ${sample.laser[i] + 1}, ${number((sample.azimuth_bin[i] + 0.5) * data.step_deg, 1)} deg, ${sample.planes[sample.plane[i]]}: before ${number(sample.states.before[i] * data.residual_mm, 1)} mm, after ${number(sample.states.after[i] * data.residual_mm, 1)} mm`
          : "Nothing was measured here.";
      });
      return { state, canvas };
    });
    holder.append(readout);
    function draw() {
      const plane = Number(select.value);
      at.fill(-1);
      for (const { state, canvas } of canvases) {
        const context = canvas.getContext("2d"), image = context.createImageData(columns, order.length);
        sample.laser.forEach((laser, i) => {
          if (plane >= 0 && sample.plane[i] !== plane) return;
          const place = rowOf.get(laser) * columns + ((sample.azimuth_bin[i] - begin + bins) % bins);
          at[place] = i;
          image.data.set([...mixed((sample.states[state][i] * data.residual_mm) / limit), 255], 4 * place);
        });
        context.putImageData(image, 0, 0);
      }
    }
    select.addEventListener("change", draw);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
    draw();
  }
  document.querySelectorAll(".map").forEach(map);

  // Planes and points in space --------------------------------------------------------------------

  // A canvas that can be turned. `draw` gets its context, and a function that makes the projection of
  // points between `low` and `high`: of (x, y, z) to (right, down, away).
  function turnable(holder, label, draw) {
    const canvas = document.createElement("canvas");
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${label} Arrow keys turn the view, plus and minus change its size, 0 resets it.`);
    holder.append(canvas);
    const initial = { turn: -0.7, lift: 0.5, size: 1 };
    const view = { ...initial };

    function redraw() {
      const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
      if (!width) return;
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      const context = canvas.getContext("2d");
      context.scale(ratio, ratio);
      const [ct, st, cl, sl] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.lift), Math.sin(view.lift)];
      const projection = (low, high) => {
        const middle = low.map((value, axis) => (value + high[axis]) / 2);
        const extent = Math.hypot(...high.map((value, axis) => value - low[axis])) || 1;
        const scale = (view.size * Math.min(width, height * 1.6)) / extent;
        return (x, y, z) => {
          const [a, b, c] = [x - middle[0], y - middle[1], z - middle[2]];
          const right = ct * a - st * b, away = st * a + ct * b;
          return [width / 2 + scale * right, height / 2 - scale * (cl * c + sl * away), cl * away - sl * c];
        };
      };
      draw(context, projection);
    }

    let grip = null;
    canvas.addEventListener("pointerdown", (event) => { grip = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointermove", (event) => {
      if (!grip) return;
      view.turn += (event.clientX - grip[0]) * 0.008;
      view.lift = Math.min(1.57, Math.max(-0.3, view.lift + (event.clientY - grip[1]) * 0.008));
      grip = [event.clientX, event.clientY];
      redraw();
    });
    canvas.addEventListener("pointerup", () => { grip = null; });
    canvas.addEventListener("pointercancel", () => { grip = null; });
    canvas.addEventListener("keydown", (event) => {
      const change = { ArrowLeft: ["turn", -0.1], ArrowRight: ["turn", 0.1], ArrowUp: ["lift", 0.1], ArrowDown: ["lift", -0.1] }[event.key];
      if (change) view[change[0]] += change[1];
      else if (event.key === "+" || event.key === "=") view.size *= 1.15;
      else if (event.key === "-") view.size /= 1.15;
      else if (event.key === "0") Object.assign(view, initial);
      else return;
      event.preventDefault();
      redraw();
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
    new ResizeObserver(redraw).observe(canvas);
    redraw();
    return redraw;
  }

  function choice(label, options) {
    const select = document.createElement("select");
    select.setAttribute("aria-label", label);
    select.append(...options.map(([value, text]) => new Option(text, value)));
    return select;
  }

  const STATES = [["before", "with the factory's values"], ["after", "with the calibration"]];

  // Numbers of points with their places on the canvas; nearer points are drawn over farther ones.
  function farthestFirst(n, place) {
    return Array.from({ length: n }, (_, i) => [i, ...place(i)]).sort((a, b) => b[3] - a[3]);
  }

  function withText(context) {
    context.fillStyle = style("--text");
    context.font = "12px system-ui, sans-serif";
  }

  function named(context, project, place, text) {
    const [x, y] = project(...place);
    context.beginPath(); context.arc(x, y, 4, 0, 2 * Math.PI); context.fill();
    context.fillText(text, x + 7, y + 4);
  }

  function scene(holder) {
    const limit = Number(holder.dataset.limitMm), samples = samplesOf(holder.dataset.scanner);
    const controls = document.createElement("p");
    controls.className = "controls";
    const sampleSelect = choice("Recording", samples.map((one, i) => [i, one.position ? `${one.sample} at ${one.position}` : one.sample]));
    const stateSelect = choice("Calibration", STATES);
    const factor = document.createElement("input");
    Object.assign(factor, { type: "range", min: 0, max: 50, value: 10 });
    factor.setAttribute("aria-label", "Factor of the residuals");
    const said = document.createElement("output");
    const label = document.createElement("label");
    label.append("residuals enlarged ", factor, said);
    controls.append(sampleSelect, " ", stateSelect, " ", label);
    holder.append(controls);

    function draw(context, projection) {
      said.textContent = ` ${factor.value} times`;
      const one = samples[Number(sampleSelect.value)], n = one.laser.length;
      const places = new Float64Array(3 * n);
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      const s = one.states[stateSelect.value], enlarged = Number(factor.value);
      for (let i = 0; i < n; i++) {
        const p = [one.x[i], one.y[i], one.z[i]].map((value) => value * data.coordinate_m);
        const length = Math.hypot(...p) || 1;
        // The point on the plane, moved along the beam by the enlarged residual.
        const shift = (-one.states.before[i] + enlarged * s[i]) * data.residual_mm * 1e-3;
        for (let axis = 0; axis < 3; axis++) {
          low[axis] = Math.min(low[axis], p[axis]);
          high[axis] = Math.max(high[axis], p[axis]);
          places[3 * i + axis] = p[axis] * (1 + shift / length);
        }
      }
      const project = projection(low, high);
      const ordered = farthestFirst(n, (i) => project(places[3 * i], places[3 * i + 1], places[3 * i + 2]));
      context.strokeStyle = style("--soft");
      context.fillStyle = style("--panel");
      one.corners.forEach((corners) => {
        if (!corners.length) return;
        context.beginPath();
        corners.forEach((corner, j) => { const [x, y] = project(...corner); j ? context.lineTo(x, y) : context.moveTo(x, y); });
        context.closePath();
        context.globalAlpha = 0.6; context.fill(); context.globalAlpha = 1; context.stroke();
      });
      for (const [i, x, y] of ordered) {
        const [r, g, b] = mixed((s[i] * data.residual_mm) / limit);
        context.fillStyle = `rgb(${r},${g},${b})`;
        context.fillRect(x - 1, y - 1, 2.2, 2.2);
      }
      withText(context);
      one.corners.forEach((corners, i) => {
        if (!corners.length) return;
        const centre = [0, 1, 2].map((axis) => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length);
        const [x, y] = project(...centre);
        context.fillText(one.planes[i], x + 4, y);
      });
      named(context, project, [0, 0, 0], "scanner");
    }

    const redraw = turnable(holder, "Planes and points in space.", draw);
    for (const control of [sampleSelect, stateSelect]) control.addEventListener("change", redraw);
    factor.addEventListener("input", redraw);
  }

  function interior(holder) {
    const room = data.interior, position = decoded(room.position, Uint8Array), n = position.length;
    const clouds = Object.fromEntries([["before", "factory"], ["after", "refined"]].map(([state, name]) => [state, room[name].map((column) => decoded(column, Int16Array))]));
    const colours = ["#4477aa", "#ee6677", "#228833", "#aa8800", "#66ccee", "#aa3377"];
    const controls = document.createElement("p");
    controls.className = "controls";
    const stateSelect = choice("Calibration", STATES);
    controls.append(stateSelect);
    holder.append(controls);
    // The same view of both clouds.
    const low = clouds.before.map((column) => column.reduce((a, b) => Math.min(a, b)) * data.coordinate_m);
    const high = clouds.before.map((column) => column.reduce((a, b) => Math.max(a, b)) * data.coordinate_m);

    function draw(context, projection) {
      const [x, y, z] = clouds[stateSelect.value], project = projection(low, high);
      const place = (i) => project(...[x[i], y[i], z[i]].map((value) => value * data.coordinate_m));
      for (const [i, right, down] of farthestFirst(n, place)) {
        context.fillStyle = colours[position[i] % colours.length];
        context.fillRect(right - 0.7, down - 0.7, 1.4, 1.4);
      }
      withText(context);
      room.scanners.forEach((place, i) => named(context, project, place, room.positions[i]));
    }

    stateSelect.addEventListener("change", turnable(holder, "Points of the interior in space.", draw));
  }

  document.querySelectorAll(".scene").forEach((holder) => {
    if (holder.classList.contains("interior")) interior(holder);
    else if (samplesOf(holder.dataset.scanner).length) scene(holder);
  });
  root.dataset.drawn = "true";
})();
