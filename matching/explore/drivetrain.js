const STILL_READ = 0.4  // scale down to which a drawing is fitted to the page
const SCROLLED = 0.8  // scale of a longer one, which scrolls
const FRAMES = 16  // of one period of a swinging mode, which lasts 2 s

const made = (name, attributes, parent) => {
  const element = document.createElementNS('http://www.w3.org/2000/svg', name)
  set(element, attributes)
  parent.append(element)
  return element
}
const set = (element, attributes) => {
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value)
}

// The mark on a disc moves as a point of its rim does, seen from the side: up and down with the angle of the inertia.
const swing = (x, y, half, real, imaginary, parent) => {
  const heights = Array.from({ length: FRAMES + 1 }, (_, frame) => {
    const turn = 2 * Math.PI * frame / FRAMES
    return (y - half * (real * Math.cos(turn) - imaginary * Math.sin(turn))).toFixed(2)
  })
  const size = Math.hypot(real, imaginary)
  const phased = Math.abs(imaginary) > 1e-9 || size < 0.005  // of an amplitude that is none, no sign
  const words = (phased ? '' : real < 0 ? '−' : '+') + size.toFixed(2)
  made('line', { x1: x, x2: x, y1: y - half, y2: y + half, stroke: '#D55E00', 'stroke-opacity': 0.6 }, parent)
  const dot = made('circle', { cx: x, cy: y, r: 3.8, fill: '#D55E00', stroke: '#fff' }, parent)
  made('animate', { attributeName: 'cy', dur: '2s', repeatCount: 'indefinite', values: heights.join(';') }, dot)
  made('text', { x: x + 12, y: y - half, 'font-size': 7.5, fill: '#A03F00' }, parent).textContent = words
}

export function render({ model }) {
  const whole = document.createElement('div')
  const box = document.createElement('div')
  const still = window.matchMedia('(prefers-reduced-motion: reduce)')
  let zoom = 1  // times the width of the page
  const fit = () => {
    for (const svg of box.querySelectorAll('svg')) {
      const least = box.clientWidth < STILL_READ * svg.width.baseVal.value ? SCROLLED * svg.width.baseVal.value : 0
      svg.style.width = `max(${100 * zoom}%, ${zoom * least}px)`
      svg.style.maxWidth = `${zoom * svg.width.baseVal.value}px`
    }
  }
  const button = (text, label, factor) => {
    const made = document.createElement('button')
    made.type = 'button'
    made.textContent = text
    made.setAttribute('aria-label', label)
    made.addEventListener('click', () => {
      const before = zoom
      const middle = box.scrollLeft + box.clientWidth / 2
      zoom = Math.min(8, Math.max(1, zoom * factor))
      fit()
      box.scrollLeft = middle * zoom / before - box.clientWidth / 2
    })
    return made
  }
  const bar = document.createElement('div')
  bar.className = 'zoom'
  bar.append(button('+', 'Larger drawing', 1.5), button('−', 'Smaller drawing', 1 / 1.5))
  box.className = 'drawing'
  box.tabIndex = 0
  box.setAttribute('role', 'region')
  box.setAttribute('aria-label', `Drawing of ${model.label}, scrolls when larger`)

  const parts = {}  // groups by name
  let shown = ''  // the part that was chosen last
  const bringIntoView = () => {
    const [name] = Object.entries(model.marks).find(([, own]) => own.class.includes('selected')) || ['']
    if (name === shown || !parts[name]) return
    shown = name
    const part = parts[name].getBoundingClientRect()
    const whole = box.getBoundingClientRect()
    if (part.left >= whole.left && part.right <= whole.right) return
    box.scrollLeft += (part.left + part.right) / 2 - (whole.left + whole.right) / 2
  }
  const mark = () => {
    box.querySelectorAll('.swing').forEach(each => each.remove())
    for (const [name, own] of Object.entries(model.marks)) {
      if (!parts[name]) continue
      const [x, y, width, height] = own.box
      const [frame, words] = parts[name].children
      set(frame, { x, y, width, height, fill: own.heat })
      words.textContent = own.words  // shown where one points
      set(parts[name], { class: own.class, 'aria-label': own.words })
      if (model.reacts) parts[name].setAttribute('aria-pressed', own.class.includes('selected'))
      if (own.swing) swing(...own.swing, made('g', { class: 'swing' }, parts[name].ownerSVGElement))
    }
    for (const svg of box.querySelectorAll('svg')) {
      svg.setCurrentTime(performance.now() / 1000 % 2)
      if (still.matches) svg.pauseAnimations()
    }
    requestAnimationFrame(bringIntoView)
  }
  const draw = () => {
    const root = box.getRootNode()
    const held = root.activeElement && root.activeElement.dataset ? root.activeElement.dataset.part : null
    const left = box.scrollLeft
    box.innerHTML = model.svg
    Object.keys(parts).forEach(name => delete parts[name])
    const svg = box.querySelector('svg')
    if (!svg) return
    set(svg, { role: model.reacts ? 'group' : 'img', 'aria-label': `Drawing of ${model.label}` })
    const shapes = [...svg.querySelectorAll('g[id*="."]')]
    const above = (shape) => shape.id.startsWith('inertias.')  // discs stand before the ends of their shafts
    for (const shape of shapes.sort((a, b) => above(a) - above(b))) {
      const name = shape.id
      if (!parts[name]) {
        parts[name] = made('g', { class: 'part' }, svg)
        if (model.reacts) set(parts[name], { 'data-part': name, role: 'button', tabindex: 0 })
        made('rect', { class: 'box', rx: 4, fill: 'transparent', stroke: 'none' }, parts[name])
        made('title', {}, parts[name])
      }
      shape.removeAttribute('id')
      parts[name].append(shape)
    }
    fit()
    mark()
    box.scrollLeft = left
    if (held && parts[held]) parts[held].focus({ preventScroll: true })
  }
  let count = 0
  let dragged = false  // since the button went down: the click that follows picks nothing
  const pick = (event) => {
    if (dragged) return
    const part = event.target.closest('[data-part]')
    if (!part) return
    event.preventDefault()
    count += 1
    model.picked = `${part.dataset.part} ${count}`
  }
  box.addEventListener('click', pick)
  box.addEventListener('keydown', (event) => { if (event.key === 'Enter' || event.key === ' ') pick(event) })
  // By the keyboard the discs come first, then what connects them; on the drawing the discs lie above.
  box.addEventListener('keydown', (event) => {
    if (event.key !== 'Tab' || !model.reacts) return
    const all = Object.values(parts)
    const isDisc = (part) => part.dataset.part.startsWith('inertias.')
    const order = [...all.filter(isDisc), ...all.filter(part => !isDisc(part))]
    const here = order.indexOf(event.target.closest('[data-part]'))
    if (here < 0 && event.shiftKey) return
    const next = order[here + (event.shiftKey ? -1 : 1)]
    if (next || event.shiftKey) {
      event.preventDefault()
      ;(next || box).focus()
      return
    }
    const others = order.filter((_, number) => number !== here)  // the browser goes on behind the drawing
    for (const part of others) part.setAttribute('tabindex', -1)
    setTimeout(() => { for (const part of others) part.setAttribute('tabindex', 0) })
  })
  // A shaft is drawn by dragging from a disc: to another disc, or into the open, where a new inertia begins.
  const disc = (x, y) => {
    const under = box.getRootNode().elementsFromPoint(x, y).map(each => each.closest('[data-part^="inertias."]'))
    return under.find(each => each) || null
  }
  box.addEventListener('pointerdown', (event) => {
    dragged = false
    const from = disc(event.clientX, event.clientY)
    if (!model.reacts || !from || event.pointerType !== 'mouse' || event.button !== 0) return
    const svg = from.ownerSVGElement
    const place = (at) => new DOMPoint(at.clientX, at.clientY).matrixTransform(svg.getScreenCTM().inverse())
    const start = place(event)
    let line = null
    const follow = (now) => {
      if (!line && Math.hypot(now.clientX - event.clientX, now.clientY - event.clientY) < 8) return
      const { x, y } = place(now)
      if (!line) {
        dragged = true
        line = made('line', { x1: start.x, y1: start.y, stroke: '#0072B2', 'stroke-width': 2, 'stroke-dasharray': '6 4',
          'pointer-events': 'none' }, svg)
      }
      set(line, { x2: x, y2: y })
    }
    const end = (now) => {
      document.removeEventListener('pointermove', follow)
      document.removeEventListener('pointerup', end)
      document.removeEventListener('pointercancel', end)
      if (line) line.remove()
      if (!line || now.type !== 'pointerup') return
      const to = disc(now.clientX, now.clientY)
      const inside = box.getBoundingClientRect()
      const open = !to && now.clientX > inside.left && now.clientX < inside.right
        && now.clientY > inside.top && now.clientY < inside.bottom
      if (to === from || !(to || open)) return
      count += 1
      model.drawn = `${from.dataset.part} ${to ? to.dataset.part : '-'} ${count}`
    }
    document.addEventListener('pointermove', follow)
    document.addEventListener('pointerup', end)
    document.addEventListener('pointercancel', end)
  })
  const takeBack = (event) => {  // of several drawings on a page, the first one answers
    if (!whole.isConnected) return document.removeEventListener('keydown', takeBack)
    const typing = /^(INPUT|TEXTAREA|SELECT)$/.test(event.composedPath()[0].tagName)
    if (!(event.ctrlKey || event.metaKey) || event.key !== 'z' || typing || event.defaultPrevented) return
    if (!whole.checkVisibility()) return
    event.preventDefault()
    model.undone += 1
  }
  if (model.reacts) document.addEventListener('keydown', takeBack)
  model.on('svg', draw)
  model.on('marks', mark)
  draw()
  whole.append(bar, box)
  new ResizeObserver(fit).observe(box)
  return whole
}
