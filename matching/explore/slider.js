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
