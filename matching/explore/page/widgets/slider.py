"""A slider that says its name and value to screen readers and moves by the arrow keys: the browser's own."""

import param
from panel.custom import JSComponent


class Slider(JSComponent):
    """A number between two ends; ``label`` is what it sets, with its unit."""

    label = param.String(default="value")
    start = param.Number(default=0.0)
    end = param.Number(default=1.0)
    step = param.Number(default=0.01)
    value = param.Number(default=0.0)

    _esm = """
export function render({ model }) {
  const label = document.createElement('label')
  const text = document.createElement('span')
  const input = document.createElement('input')
  input.type = 'range'
  label.append(text, input)
  const words = () => { text.textContent = `${model.label}: ${Number(model.value.toPrecision(4))}` }
  const take = () => {
    input.min = model.start; input.max = model.end; input.step = model.step; input.value = model.value
    words()
  }
  input.addEventListener('input', () => { model.value = Number(input.value); words() })
  for (const name of ['label', 'start', 'end', 'step', 'value']) model.on(name, () => {
    if (name !== 'value' || Number(input.value) !== model.value) take()
  })
  take()
  return label
}
"""

    _stylesheets = [
        """
label { display: flex; flex-direction: column; padding: 0 5px; font: 15px/1.45 system-ui, sans-serif; color: #1a1a1a; }
input { width: 100%; accent-color: #0072B2; }
"""
    ]
