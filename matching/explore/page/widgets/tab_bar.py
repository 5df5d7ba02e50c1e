"""The row of tabs: buttons that screen readers know as tabs; arrow keys move between them."""

import param
from panel.custom import JSComponent


class TabBar(JSComponent):
    """Names of tabs, and the number of the one that is open."""

    names = param.List(default=[], item_type=str)
    active = param.Integer(default=0)

    _esm = """
export function render({ model }) {
  const bar = document.createElement('div')
  bar.setAttribute('role', 'tablist')
  bar.setAttribute('aria-label', 'Views')
  const buttons = model.names.map((name, number) => {
    const button = document.createElement('button')
    button.textContent = name
    button.setAttribute('role', 'tab')
    button.addEventListener('click', () => { model.active = number })
    bar.append(button)
    return button
  })
  const mark = () => buttons.forEach((button, number) => {
    button.setAttribute('aria-selected', number === model.active ? 'true' : 'false')
    button.tabIndex = number === model.active ? 0 : -1
  })
  bar.addEventListener('keydown', (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key]
    if (!step) return
    event.preventDefault()
    model.active = (model.active + step + buttons.length) % buttons.length
    mark()
    buttons[model.active].focus()
  })
  model.on('active', mark)
  mark()
  return bar
}
"""

    _stylesheets = [
        """
div { display: flex; flex-wrap: wrap; gap: 4px; border-bottom: 1px solid #888; }
button { font: 15px/1.4 system-ui, sans-serif; padding: 6px 14px; border: 1px solid #888; border-bottom: none;
  border-radius: 4px 4px 0 0; background: #f0f0f0; color: #1a1a1a; cursor: pointer; }
button[aria-selected="true"] { background: #0072B2; color: #fff; border-color: #0072B2; }
button:focus-visible { outline: 3px solid #000; outline-offset: 1px; }
"""
    ]
