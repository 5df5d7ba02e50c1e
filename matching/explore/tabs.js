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
