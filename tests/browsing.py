"""Pages in a browser, with their messages and requests."""


def open_page(browser, uri, width, scheme):
    """A page of a width and a colour scheme; `said` are its messages, `asked` the addresses it requests."""
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page.said, page.asked = [], []
    page.on("console", lambda message: page.said.append(message.text))
    page.on("pageerror", lambda error: page.said.append(str(error)))
    page.on("request", lambda request: page.asked.append(request.url))
    page.goto(uri)
    return page
