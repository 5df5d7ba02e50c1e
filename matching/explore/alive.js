// Asks every second whether the program is still there; fits the page to the screen.
const EVERY = 1000, LATE = 10000 // ms; a program that computes answers late, one that has ended refuses at once
export function render({ model, el }) {
  const cover = document.createElement('div')
  cover.setAttribute('role', 'alertdialog')
  cover.setAttribute('aria-label', 'The program has ended')
  cover.hidden = true
  const words = document.createElement('p')
  cover.append(words)
  document.body.append(cover)
  Object.assign(cover.style, { position: 'fixed', inset: 0, zIndex: 100000, background: 'rgba(20, 20, 20, .82)' })
  Object.assign(words.style, { maxWidth: '46em', margin: '12vh auto', padding: '1.2em 1.6em', borderRadius: '8px',
    background: '#fff', color: '#1a1a1a', borderLeft: '8px solid #D55E00', font: '17px/1.5 system-ui, sans-serif' })
  const say = (text) => {
    words.textContent = text
    cover.hidden = !text
    cover.style.display = text ? 'block' : 'none'
    for (const other of document.body.children) if (other !== cover) other.inert = Boolean(text)
  }
  say('')
  let answered = Date.now(), gone = false
  const ask = async () => {
    try {
      await fetch(new URL('alive', location.href), { cache: 'no-store', signal: AbortSignal.timeout(LATE) })
      answered = Date.now()
      if (gone) location.reload()
    } catch (fault) {
      if (fault.name === 'TimeoutError' && Date.now() - answered < LATE) return
      gone = true
      say('rigmatch has ended, or does not answer. Nothing that you change here is saved any more. '
        + 'Start it again (rigmatch explore …) and open the address that it prints; what was saved is in your files.')
    }
  }
  const timer = setInterval(ask, EVERY)
  // The look follows the system; on a phone the steps are a drawer, which closes when one is picked.
  const dark = matchMedia('(prefers-color-scheme: dark)'), narrow = matchMedia('(max-width: 900px)')
  const shell = () => Bokeh.documents.flatMap((doc) => [...doc.all_models]).find((each) => each.data && 'sidebar_open' in each.data)
  const look = (tries) => {
    const page = shell()
    if (!page) return tries > 0 && setTimeout(look, 100, tries - 1)
    named()
    page.data.dark_theme = dark.matches
    if (narrow.matches) page.data.sidebar_open = false
  }
  dark.addEventListener('change', () => look(0))
  narrow.addEventListener('change', () => look(0))
  // What the page's frame leaves without a name for screen readers, as soon as it is there.
  const named = () => {
    for (let root = el.getRootNode(); root; root = root.host && root.host.getRootNode()) {
      for (const [part, name] of [['.MuiDrawer-paper', 'Steps and files'], ['[role=progressbar]', 'Busy']])
        for (const each of root.querySelectorAll(`${part}:not([aria-label])`)) each.setAttribute('aria-label', name)
      if (seen.has(root)) continue
      seen.add(root)
      watching.observe(root, { childList: true, subtree: true })
    }
  }
  const seen = new WeakSet(), watching = new MutationObserver(named)
  addEventListener('rigmatch-step', () => { if (narrow.matches) shell().data.sidebar_open = false })
  look(50)
  model.on('remove', () => { clearInterval(timer); watching.disconnect(); cover.remove() })
  return document.createElement('span')
}
