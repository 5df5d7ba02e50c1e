// Zoom (drag a box; double click: back) and values where one points, in the SVG of every figure.
const NS = "http" + "://www.w3.org/2000/svg"
const forward = { linear: v => v, log: v => Math.log10(Math.max(v, 1e-300)),
  symlog: (v, t) => Math.abs(v) <= t ? v / t / 0.9 : Math.sign(v) * (1 / 0.9 + Math.log10(Math.abs(v) / t)) }
const back = { linear: p => p, log: p => 10 ** p,
  symlog: (p, t) => Math.abs(p) <= 1 / 0.9 ? p * t * 0.9 : Math.sign(p) * t * 10 ** (Math.abs(p) - 1 / 0.9) }
const digits = v => String(Number(v.toPrecision(4)))
const element = (name, attributes) => {
  const made = document.createElementNS(NS, name)
  for (const key in attributes) made.setAttribute(key, attributes[key])
  return made
}
function ticks(low, high, logarithmic) {
  const found = []
  if (logarithmic && high > 20 * low) {
    for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k++)
      for (const m of high < 200 * low ? [1, 2, 5] : [1]) found.push(m * 10 ** k)
  } else {
    const least = (high - low) / 5, decade = 10 ** Math.floor(Math.log10(least))
    const step = decade * [1, 2, 5, 10].find(m => m * decade >= least)
    for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step)
  }
  return found.filter(v => v >= low && v <= high)
}
class Panel {
  constructor(svg, group, known, tip) {
    Object.assign(this, { svg, group, known, tip })
    const box = group.querySelector(":scope > g > path").getBBox()  // the ground of the axes
    Object.assign(this, { box, view: null, pieces: [], texts: [] })
    const own = [...group.children].filter(child => !child.id.startsWith("matplotlib.axis"))
    for (const each of own.flatMap(child => [child, ...child.querySelectorAll("*")]))
      if (each.hasAttribute("clip-path")) this.pieces.push(each)
    const inside = ({ x, y, width, height }) => x + width / 2 > box.x && x + width / 2 < box.x + box.width
      && y + height / 2 > box.y && y + height / 2 < box.y + box.height
    for (const each of own) if (each.id.startsWith("text_") && inside(each.getBBox())) this.texts.push(each)
    this.curves = own.filter(child => child.id.startsWith("curve: ")).map(child => ({
      label: child.id.slice(7), dots: child.querySelector("use") !== null, points: this.pointsOf(child) }))
    this.layer = element("g", { "pointer-events": "none" })
    this.ground = element("rect", { x: box.x, y: box.y, width: box.width, height: box.height, fill: "transparent",
      style: "cursor: crosshair; touch-action: pan-y" })
    group.append(this.layer, this.ground)
    this.listen()
  }
  pointsOf(group) {
    const path = group.querySelector("path[d]"), uses = [...group.querySelectorAll("use")]
    if (uses.length) return uses.map(use => [Number(use.getAttribute("x")), Number(use.getAttribute("y"))])
    const text = path && !path.closest("defs") ? path.getAttribute("d") : ""
    return [...text.matchAll(/[ML]\s*(-?[\d.]+) (-?[\d.]+)/g)].map(found => [Number(found[1]), Number(found[2])])
  }
  // Of the point (x, y) of the picture the value, and the reverse; x and y of the axes as the picture has them
  value(which, at) {
    const { ends, scale, linear } = this.known[which], [low, high] = ends.map(v => forward[scale](v, linear))
    const { x, y, width, height } = this.box
    const share = which === "x" ? (at - x) / width : (y + height - at) / height
    return back[scale](low + share * (high - low), linear)
  }
  place(which, value) {
    const { ends, scale, linear } = this.known[which], [low, high] = ends.map(v => forward[scale](v, linear))
    const share = (forward[scale](value, linear) - low) / (high - low), { x, y, width, height } = this.box
    return which === "x" ? x + share * width : y + height - share * height
  }
  at(event) {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse())
    return this.view ? { x: point.x, y: point.y, px: this.view.x + (point.x - this.box.x) / this.view.kx,
      py: this.view.y + (point.y - this.box.y) / this.view.ky } : { x: point.x, y: point.y, px: point.x, py: point.y }
  }
  listen() {
    let begun = null, mark = null
    this.ground.addEventListener("pointerdown", event => {
      if (event.pointerType === "touch") return
      begun = this.at(event)
      mark = element("rect", { fill: "#0072B2", opacity: 0.15 })
      this.layer.append(mark)
      this.ground.setPointerCapture(event.pointerId)
    })
    this.ground.addEventListener("pointermove", event => {
      const now = this.at(event)
      if (!begun) return this.tell(event, now)
      mark.setAttribute("x", Math.min(begun.x, now.x)); mark.setAttribute("width", Math.abs(now.x - begun.x))
      mark.setAttribute("y", Math.min(begun.y, now.y)); mark.setAttribute("height", Math.abs(now.y - begun.y))
    })
    this.ground.addEventListener("pointerup", event => {
      if (!begun) return
      const now = this.at(event), [x, y] = [Math.min(begun.px, now.px), Math.min(begun.py, now.py)]
      const width = Math.abs(now.px - begun.px), height = Math.abs(now.py - begun.py)
      begun = null
      mark.remove()
      if (width > 0.01 * this.box.width && height > 0.01 * this.box.height) this.show({ x, y, width, height })
    })
    this.ground.addEventListener("dblclick", () => this.show(null))
    this.ground.addEventListener("pointerleave", () => { this.tip.hidden = true; this.dot?.remove() })
  }
  show(view) {
    const { box } = this
    this.view = view && { ...view, kx: box.width / view.width, ky: box.height / view.height }
    const { x, y, kx, ky } = this.view || { x: box.x, y: box.y, kx: 1, ky: 1 }
    const move = (px, py) => [box.x + (px - x) * kx, box.y + (py - y) * ky]
    for (const piece of this.pieces) {
      const uses = [...piece.querySelectorAll("use"), ...(piece.tagName === "use" ? [piece] : [])]
      for (const use of uses) {
        use.from ??= [Number(use.getAttribute("x")), Number(use.getAttribute("y"))]
        const [px, py] = move(...use.from)
        use.setAttribute("x", px); use.setAttribute("y", py)
      }
      if (uses.length) continue
      if (!piece.clip) {  // the clip stays where it is: it moves into a group around the piece
        piece.clip = element("g", { "clip-path": piece.getAttribute("clip-path") })
        piece.removeAttribute("clip-path")
        piece.replaceWith(piece.clip)
        piece.clip.append(piece)
        piece.own = piece.getAttribute("transform") || ""
        for (const path of [piece, ...piece.querySelectorAll("path")]) path.setAttribute("vector-effect", "non-scaling-stroke")
      }
      piece.setAttribute("transform", `matrix(${kx} 0 0 ${ky} ${box.x - x * kx} ${box.y - y * ky}) ${piece.own}`)
    }
    for (const text of this.texts) {
      text.from ??= text.getBBox()
      const [px, py] = move(text.from.x + text.from.width / 2, text.from.y + text.from.height / 2)
      const inside = px > box.x && px < box.x + box.width && py > box.y && py < box.y + box.height
      text.style.display = !this.view || inside ? "" : "none"
      text.setAttribute("transform", this.view
        ? `translate(${px - text.from.x - text.from.width / 2} ${py - text.from.y - text.from.height / 2})` : "")
    }
    this.layer.replaceChildren()
    for (const axis of this.group.querySelectorAll(":scope > g[id^='matplotlib.axis']"))
      for (const tick of axis.children) if (/tick_/.test(tick.id)) tick.style.display = this.view ? "none" : ""
    if (this.view) for (const which of "xy") this.drawTicks(which)
  }
  drawTicks(which) {
    const { box, view, known } = this, { names, scale } = known[which]
    const ends = which === "x" ? [view.x, view.x + view.width] : [view.y, view.y + view.height]
    const [low, high] = ends.map(at => this.value(which, at)).sort((a, b) => a - b)
    const named = names.length ? names : ticks(low, high, scale === "log").map(v => [v, digits(v)])
    for (const [value, words] of named) {
      const own = this.place(which, value)
      const at = which === "x" ? box.x + (own - view.x) * view.kx : box.y + (own - view.y) * view.ky
      const bottom = box.y + box.height
      if (value < low || value > high) continue
      const text = which === "x" ? { x: at, y: bottom + 12, "text-anchor": "middle" }
        : { x: box.x - 6, y: at + 3, "text-anchor": "end" }
      const label = element("text", { ...text, style: "font: 9px sans-serif" })
      label.textContent = words
      const line = which === "x" ? { x1: at, x2: at, y1: bottom, y2: bottom + 3 }
        : { x1: box.x - 3, x2: box.x, y1: at, y2: at }
      this.layer.append(label, element("line", { ...line, stroke: "#000", "stroke-width": 0.8 }))
    }
  }
  tell(event, { px, py }) {
    const { known } = this, named = which => known[which].label.split(" in ")[0].slice(0, 40) || which
    const value = which => digits(this.value(which, which === "x" ? px : py))
    const unit = which => known[which].label.includes(" in ") ? " " + known[which].label.split(" in ").pop() : ""
    let words = [], near = null, least = 30
    for (const { label, dots, points } of this.curves)
      points.forEach(([x, y], k) => {
        const [before, height] = points[k - 1] ?? [x, y]
        if (!dots && (px - before) * (px - x) <= 0 && x !== before)  // on the line, where one points
          [x, y] = [px, height + (y - height) * (px - before) / (x - before)]
        const far = Math.hypot(x - px, 0.5 * (y - py))
        if (far < least) [near, least] = [{ label, x, y }, far]
      })
    this.ground.style.pointerEvents = "none"
    const below = document.elementFromPoint(event.clientX, event.clientY)?.closest("g[id^='bar: ']")
    this.ground.style.pointerEvents = ""
    const fields = known.fields, cell = (list, v) => list.findIndex((edge, k) => v >= edge && v < list[k + 1])
    if (below) words = [below.id.slice(5)]
    else if (fields) {
      const row = fields.values[cell(fields.y, this.value("y", py))]
      words = [`${fields.of}: ${row?.[cell(fields.x, this.value("x", px))] ?? ""}`, `${named("x")}: ${value("x")}${unit("x")}`,
        `${named("y")}: ${value("y")}${unit("y")}`]
    } else if (near) {
      [px, py] = [near.x, near.y]
      words = [near.label, `${named("x")}: ${value("x")}${unit("x")}`, `${named("y")}: ${value("y")}${unit("y")}`]
    }
    this.tip.hidden = !words.length
    this.tip.textContent = words.filter(Boolean).join("\n")
    this.tip.style.left = `${Math.min(event.pageX + 14, document.documentElement.clientWidth - 260)}px`
    this.tip.style.top = `${event.pageY + 14}px`
  }
}
// The entries of a legend, each with its stroke and its name: on a narrow screen they stand one below the other.
function entries(legend) {
  const found = [[]], whole = legend.getBBox().width
  for (const each of legend.children) {
    if (legend.children.length > 2 && each.getBBox().width > 0.9 * whole) continue  // the frame
    found.at(-1).push(each)
    if (each.id.startsWith("text")) found.push([])
  }
  return found.filter(parts => parts.length)
}
// On a narrow screen every panel stands alone, so that its letters can be read.
function apart(svg, count) {
  const alone = [], words = svg.closest("figure")?.getAttribute("aria-label") || "figure"
  for (let k = 0; k < count; k++) {
    const group = svg.querySelector(`[id="acts-${k}"]`)
    if (!group) continue
    const { x, y, width, height } = group.getBBox()
    const own = element("svg", {
      viewBox: `${x - 4} ${y - 4} ${width + 8} ${height + 8}`, width: "100%", role: "img",
      "aria-label": `${words} (panel ${k + 1} of ${count})`,
    })
    own.append(...[...svg.querySelectorAll("defs")].map(each => each.cloneNode(true)), group.cloneNode(true))
    alone.push(own)
  }
  const defs = () => [...svg.querySelectorAll("defs")].map(each => each.cloneNode(true))
  for (const legend of svg.querySelectorAll("[id='figure_1'] > [id^='legend']")) {
    const row = document.createElement("div")
    for (const parts of entries(legend)) {
      const boxes = parts.map(each => each.getBBox())
      const x = Math.min(...boxes.map(each => each.x)), y = Math.min(...boxes.map(each => each.y)) - 2
      const width = Math.max(...boxes.map(each => each.x + each.width)) - x
      const height = Math.max(...boxes.map(each => each.y + each.height)) - y + 2
      const style = `width: ${1.33 * width}px; max-width: 100%`
      const own = element("svg", { viewBox: `${x} ${y} ${width} ${height}`, style })
      own.append(...defs(), ...parts.map(each => each.cloneNode(true)))
      row.append(own)
    }
    alone.unshift(row)
  }
  return alone
}
const tip = document.createElement("div")
tip.className = "tip"
tip.hidden = true
document.body.append(tip)
function begin(box) {
  if (box.begun || !box.getClientRects().length) return
  box.begun = true
  const known = JSON.parse(box.dataset.axes), svg = box.querySelector("svg")
  let shown = [svg]
  if (window.innerWidth < 700 && known.length > 1) {
    shown = apart(svg, known.length)
    const narrow = document.createElement("div")
    narrow.className = "narrow"
    narrow.append(...shown)
    svg.classList.add("whole-picture")
    box.append(narrow)
  }
  for (const each of shown) known.forEach((scales, k) => {
    const group = each.querySelector(`[id="acts-${k}"]`)
    if (group) new Panel(each, group, scales, tip)
  })
}
const begin_all = () => document.querySelectorAll(".acts").forEach(begin)
for (const fold of document.querySelectorAll("details")) fold.addEventListener("toggle", begin_all)
begin_all()
for (const button of document.querySelectorAll("button.all")) button.addEventListener("click", () => {
  const folds = [...document.querySelectorAll("details")], closed = folds.some(each => !each.open)
  for (const each of folds) each.open = closed
  button.textContent = closed ? "Close all" : "Open all, as for printing"
})
