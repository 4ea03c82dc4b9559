"""What happens to the measurements and how they travel. Start reading at `pipeline/app.py`.

AccelerationBlock → [identification] → ModalEstimate → [updating] → FoundationPosterior
"""
