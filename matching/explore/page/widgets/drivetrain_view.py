"""The drawing as an element of the page: as wide as the page, larger on request; parts are picked by mouse or keys."""

import param
from panel.custom import JSComponent


class DrivetrainView(JSComponent):
    """An SVG whose parts (``data-part``) can be picked; ``picked`` is the last, with a count that makes it new."""

    label = param.String(default="the drivetrain")
    svg = param.String(default="")
    picked = param.String(default="")

    _esm = """
export function render({ model, el }) {
  const whole = document.createElement('div')
  const box = document.createElement('div')
  let zoom = 1  // times the width of the page
  const fit = () => {
    for (const svg of box.querySelectorAll('svg')) {
      svg.style.width = `${100 * zoom}%`
      svg.style.maxWidth = `${zoom * svg.width.baseVal.valueInSpecifiedUnits}px`
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
  const still = window.matchMedia('(prefers-reduced-motion: reduce)')
  const draw = () => {
    const root = box.getRootNode()
    const held = root.activeElement && root.activeElement.dataset ? root.activeElement.dataset.part : null
    const left = box.scrollLeft
    box.innerHTML = model.svg
    fit()
    box.scrollLeft = left
    for (const svg of box.querySelectorAll('svg')) {
      svg.setCurrentTime(performance.now() / 1000 % 2)
      if (still.matches) svg.pauseAnimations()
    }
    if (held) {
      const again = box.querySelector(`[data-part="${CSS.escape(held)}"]`)
      if (again) again.focus({ preventScroll: true })
    }
  }
  let count = 0
  const pick = (event) => {
    const part = event.target.closest('[data-part]')
    if (!part) return
    event.preventDefault()
    count += 1
    model.picked = `${part.dataset.part} ${count}`
  }
  box.addEventListener('click', pick)
  box.addEventListener('keydown', (event) => { if (event.key === 'Enter' || event.key === ' ') pick(event) })
  model.on('svg', draw)
  draw()
  whole.append(bar, box)
  return whole
}
"""

    _stylesheets = [
        """
.drawing { overflow-x: auto; border: 1px solid #ccc; background: #fff; padding: 4px; max-width: 100%; }
.drawing:focus-visible { outline: 2px solid #0072B2; }
.drawing svg { display: block; height: auto; }
.zoom { display: flex; gap: 4px; justify-content: flex-end; padding: 2px 0; }
.zoom button { width: 30px; height: 26px; border: 1px solid #888; border-radius: 4px; background: #fff; }
.part[data-part] { cursor: pointer; }
.part .box { stroke-width: 0.03; }
.part[data-part]:hover .box { stroke: #888; }
.part.changed .box { stroke: #D55E00; stroke-width: 0.045; stroke-dasharray: 0.12 0.06; }
.part.selected .box { stroke: #0072B2; stroke-width: 0.05; stroke-dasharray: none; }
.part:focus { outline: none; }
.part:focus-visible .box { stroke: #000; stroke-width: 0.07; }
"""
    ]
