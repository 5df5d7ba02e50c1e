export function render({ model }) {
  const bar = document.createElement('div')
  bar.setAttribute('role', 'tablist')
  bar.setAttribute('aria-orientation', 'vertical')
  bar.setAttribute('aria-label', 'Steps')
  const states = []
  const buttons = model.names.map((name, number) => {
    const button = document.createElement('button')
    const words = document.createElement('span')
    const title = document.createElement('b')
    const state = document.createElement('small')
    title.textContent = name
    words.append(title, state)
    button.append(words)
    button.setAttribute('role', 'tab')
    button.addEventListener('click', () => {
      model.active = number
      dispatchEvent(new Event('rigmatch-step'))
    })
    bar.append(button)
    states.push(state)
    return button
  })
  const mark = () => buttons.forEach((button, number) => {
    button.setAttribute('aria-selected', number === model.active ? 'true' : 'false')
    button.tabIndex = number === model.active ? 0 : -1
  })
  const tell = () => buttons.forEach((button, number) => {
    states[number].textContent = model.states[number] ? ` ${model.states[number]}` : ''
    button.classList.toggle('running', (model.states[number] || '').startsWith('running'))
  })
  bar.addEventListener('keydown', (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key]
    if (!step) return
    event.preventDefault()
    model.active = (model.active + step + buttons.length) % buttons.length
    mark()
    buttons[model.active].focus()
  })
  model.on('active', mark)
  model.on('states', tell)
  mark()
  tell()
  return bar
}
