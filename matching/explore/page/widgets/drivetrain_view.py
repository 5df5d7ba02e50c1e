"""The drawing as an element of the page: its parts are picked by mouse, Enter or space."""

import param
from panel.custom import JSComponent


class DrivetrainView(JSComponent):
    """An SVG whose parts (``data-part``) can be picked; ``picked`` is the last, with a count that makes it new."""

    svg = param.String(default="")
    picked = param.String(default="")

    _esm = """
export function render({ model, el }) {
  const box = document.createElement('div')
  box.className = 'drawing'
  box.tabIndex = 0
  box.setAttribute('role', 'region')
  box.setAttribute('aria-label', 'Drawing of the drivetrain, scrolls sideways')
  const still = window.matchMedia('(prefers-reduced-motion: reduce)')
  const draw = () => {
    const root = box.getRootNode()
    const held = root.activeElement && root.activeElement.dataset ? root.activeElement.dataset.part : null
    const left = box.scrollLeft
    box.innerHTML = model.svg
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
  return box
}
"""

    _stylesheets = [
        """
.drawing { overflow-x: auto; border: 1px solid #ccc; background: #fff; padding: 4px; max-width: 100%; }
.drawing:focus-visible { outline: 2px solid #0072B2; }
.drawing svg { display: block; }
.part[data-part] { cursor: pointer; }
.part .box { stroke-width: 0.03; }
.part[data-part]:hover .box { stroke: #888; }
.part.changed .box { stroke: #D55E00; stroke-width: 0.045; stroke-dasharray: 0.12 0.06; }
.part.selected .box { stroke: #0072B2; stroke-width: 0.05; stroke-dasharray: none; }
.part:focus { outline: none; }
.part:focus-visible .box { stroke: #000; stroke-width: 0.07; }
"""
    ]
