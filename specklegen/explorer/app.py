"""The explorer's page: it lays out controls and panels, and keeps the state in the address. Run by marimo."""

import marimo  # pyright: ignore[reportMissingImports] - of the extra explore

app = marimo.App(width="full", app_title="specklegen explorer")


@app.cell
def _():
    import marimo as mo  # pyright: ignore[reportMissingImports]

    from specklegen.explorer import page
    from specklegen.explorer.controls import CONTROLS, State, address_of, read, shown

    return CONTROLS, State, address_of, mo, page, read, shown


@app.cell
def _(CONTROLS, mo, read):
    address = mo.query_params()
    begun, said = read({name: str(address[name]) for name in address})
    controls = mo.ui.dictionary({
        name: mo.ui.dropdown(control.steps, value=getattr(begun, name), label=control.label)
        if isinstance(control.steps[0], str)
        else mo.ui.slider(steps=control.steps, value=getattr(begun, name), label=control.label, debounce=True,
                          show_value=True, full_width=True)
        for name, control in CONTROLS.items()
    })  # fmt: skip
    draw_sixteen = mo.ui.run_button(label="Sixteen samples")
    drawn = {}  # panels as they stand on this page
    return address, begun, controls, draw_sixteen, drawn, said


@app.cell
def _(State, address, address_of, controls):
    state = State(**controls.value)
    stated = address_of(state)
    for gone in [name for name in address if name not in stated]:
        address.remove(gone)
    for name, value in stated.items():
        address.set(name, value)
    return (state,)


@app.cell
def _(begun, controls, draw_sixteen, mo, page, said, shown, state):
    mo.Html(
        page.head(said if state == begun else ())
        + page.sliders(controls.elements[name].text for name in shown(state))
        + page.buttons(
            *(mo.download(held, filename=name, label=label).text for label, name, held in page.files(state)),
            *([draw_sixteen.text] if page.has_sixteen(state) else []),
        )
    )
    return


@app.cell
def _(drawn, mo, page, state):
    every = ""
    for every in page.coming(state, drawn):
        mo.output.replace(mo.Html(every))
    mo.Html(every)
    return


@app.cell
def _(draw_sixteen, mo, page, state):
    mo.stop(not (draw_sixteen.value and page.has_sixteen(state)))
    sheet, archive = page.sixteen(state)
    mo.vstack([mo.Html(sheet), mo.download(archive, filename="sixteen.npz", label="Arrays (NPZ)")])
    return


if __name__ == "__main__":
    app.run()
